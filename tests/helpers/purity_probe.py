"""Server that replays recorded tasks, each in a forked process and under watch, and reports outputs and problems.

Everything that must not matter differs from the first run: working directory, environment, hash seed, clock, global random state.
Inputs are read-only. An audit hook records what Python opens; where the kernel has Landlock, no library can open more either.
"""

from __future__ import annotations

import dataclasses
import datetime
import gc
import importlib
import io
import json
import os
import sys
import time
import traceback
from pathlib import Path
from typing import Any, get_type_hints

SYSTEM = ("/usr/lib", "/usr/lib64", "/usr/local/lib", "/lib", "/lib64", "/etc/ld.so.cache")  # shared libraries
MACHINE = ("/dev/null", "/dev/urandom", "/proc", "/sys/devices/system", "/sys/fs/cgroup",  # hash seeds, number of cores
           "/usr/share/zoneinfo")  # pandas, which pyarrow loads, wants to know UTC
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
FORBIDDEN = ("socket.", "subprocess.", "os.exec", "os.posix_spawn", "os.system", "os.fork", "os.spawn", "urllib.", "webbrowser.")
LOOKING = ("os.listdir", "os.scandir", "os.walk", "os.fwalk")
CHANGING = ("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.chmod", "os.chown", "os.link", "os.symlink", "os.truncate",
            "os.utime", "os.chdir")
EARLY = ("numpy", "cv2", "scipy.sparse", "scipy.optimize", "scipy.ndimage", "scipy.stats", "skimage.measure", "pandas",
         "pyarrow.parquet", "numba", "torch", "torch.utils.data", "torch._dynamo", "h5py", "mujoco", "trimesh", "urllib3")
"""libraries that load before the watch begins, once for all stages; some of them must: built on datetime and its layout in C
(pandas); looks for a temporary folder (dill, a cache of compiled code that every optimiser of torch loads); calls `uname` (h5py);
starts a process to find a window library (mujoco); opens a socket to see whether the system has IPv6 (urllib3)"""
LATER_S = 400_000_000.0  # the clock of the probe is twelve years ahead


class Watch:
    """An audit hook. `problems` are events that a pure stage does not cause."""

    def __init__(self, readable: list[str], sources: list[str], writable: list[str]) -> None:
        self.readable = tuple(map(os.path.realpath, readable))
        self.sources = set(map(os.path.realpath, sources))
        self.writable = tuple(map(os.path.realpath, writable))
        self.problems: list[str] = []
        self.on = False

    def __call__(self, event: str, args: tuple[Any, ...]) -> None:
        if not self.on:
            return
        self.on = False
        try:
            self._see(event, args)
        finally:
            self.on = True

    def _see(self, event: str, args: tuple[Any, ...]) -> None:
        if event == "open" and isinstance(args[0], (str, bytes)):
            writes = bool((args[2] or 0) & WRITING)
            self._file("write" if writes else "read", os.fsdecode(args[0]))
        elif event in LOOKING and not isinstance(args[0], int):
            self._file("list", os.fsdecode(args[0] or "."))
        elif event in CHANGING and not isinstance(args[0], int):
            self._file("write", os.fsdecode(args[0]))
        elif event.startswith(FORBIDDEN):
            self.problems.append(f"{event} {args[:1]}")

    def _file(self, how: str, path: str) -> None:
        path = os.path.realpath(path)
        good = self.writable if how == "write" else (*self.readable, *self.writable)
        if how == "read" and _source_of(path) in self.sources:
            return
        if how == "list" and any(source.startswith(f"{path}/") for source in self.sources):
            return  # the import system lists the folders of packages
        if not any(path == place or path.startswith(f"{place}/") for place in good) and path != "/dev/null":
            self.problems.append(f"{how} {path} {self._where()}")

    def _where(self) -> str:
        """The line of ours that led here."""
        frame = sys._getframe()
        while frame.f_back and (frame.f_code.co_filename not in self.sources):
            frame = frame.f_back
        return f"at {frame.f_code.co_filename}:{frame.f_lineno}"


def _source_of(path: str) -> str:
    """The .py file behind a compiled one."""
    folder, name = os.path.split(path)
    return f"{os.path.dirname(folder)}/{name.partition('.')[0]}.py" if folder.endswith("__pycache__") else path


class Context:
    """A scratch folder and no bar."""

    def __init__(self, scratch: Path) -> None:
        self.scratch = scratch

    def progress(self, done: int, total: int) -> None:
        """Ignore the progress."""


def main(job: dict[str, Any]) -> list[dict[str, Any]]:
    from afford.codecs import CODEC
    from runner.store import Store, prepare_store

    store, work = Store(Path(job["store"]), CODEC), Path(job["work"])
    inputs = [{name: store.load(digest) for name, digest in task["inputs"].items()} for task in job["tasks"]]
    files = [str(file) for values in inputs for value in values.values() for file in freeze(value)]
    watch = _guard(job, files)
    prepare_store(work / "store")
    out = Store(work / "store", CODEC)
    return [_replay(task, values, out, work / str(number), watch)
            for number, (task, values) in enumerate(zip(job["tasks"], inputs, strict=True))]


def _guard(job: dict[str, Any], files: list[str]) -> Watch:
    """Start the watch: allow declared files and folders only."""
    python = [sys.prefix, sys.base_prefix + "/lib", os.path.dirname(os.__file__), os.path.dirname(sys.executable)]
    readable = [*python, *SYSTEM, *MACHINE, *files, *job["models"], "matplotlibrc"]
    writable = [job["work"], os.environ["NUMBA_CACHE_DIR"], os.environ["MPLCONFIGDIR"]]
    watch = Watch(readable, job["sources"], writable)
    sys.addaudithook(watch)
    from tests.helpers.landlock import available, restrict

    if available():
        restrict([Path(job["root"])], map(Path, [*readable, *job["sources"]]), map(Path, [*writable, "/dev/null"]))
    return watch


def _replay(task: dict[str, Any], inputs: dict[str, Any], out: Any, scratch: Path, watch: Watch) -> dict[str, Any]:
    (scratch / "work").mkdir(parents=True)
    before = {name: out.codec.digest(value) for name, value in inputs.items() if not isinstance(value, tuple)}
    printed, watch.problems = io.StringIO(), []
    sys.stdout = sys.stderr = printed
    try:
        watch.on = True
        value = _run(task, inputs, scratch)
        watch.on = False
        digest = out.put(value, scratch)
    except Exception:
        watch.on, digest = False, ""
        watch.problems.append(traceback.format_exc())
    sys.stdout, sys.stderr = sys.__stdout__, sys.__stderr__
    problems = list(dict.fromkeys(watch.problems)) + [f"printed {printed.getvalue()!r}"] * bool(printed.getvalue())
    problems += [f"changed its input {name}" for name, old in before.items() if out.codec.digest(inputs[name]) != old]
    return {"output": digest, "blobs": blobs(out, digest) if digest else [], "problems": problems}


def _run(task: dict[str, Any], inputs: dict[str, Any], scratch: Path) -> object:
    from afford.common.worker import prepare

    prepare(seed=99, threads=task["threads"])
    module, _, name = task["function"].partition(":")
    stage = importlib.import_module(module)
    more = {"ctx": Context(scratch / "work")} if task["wants_ctx"] else {}
    return getattr(stage, name)(**inputs, params=_params(stage.Params, task["params"]), **more)


def _params(kind: type, fields: dict[str, Any]) -> Any:
    """Parameters from their canonical tree, those of a block too."""
    hints = get_type_hints(kind)
    found = {key: _params(hints[key], value["fields"]) if isinstance(value, dict) and "fields" in value else value
             for key, value in fields.items()}
    return kind(**{key: tuple(value) if isinstance(value, list) else value for key, value in found.items()})


def blobs(store: Any, digest: str) -> list[list[str]]:
    """Name and digest of every file of an artifact."""
    return [[entry.name, entry.blob] for _, found in store.closure(digest) for entry in found.files]


def freeze(value: Any) -> list[Path]:
    """Make the arrays of a value read-only; the files that it refers to."""
    from afford.codecs.kinds import LazyTuple

    if isinstance(value, LazyTuple):
        return list(value.files)
    if isinstance(value, tuple):
        return [path for item in value for path in freeze(item)]
    if dataclasses.is_dataclass(value):
        return [path for field in dataclasses.fields(value) for path in freeze(getattr(value, field.name))]
    if hasattr(value, "flags"):
        value.flags.writeable = False
    return [value] if isinstance(value, Path) else []


def fake_clock() -> None:
    """Shift every clock; sleeping takes the real time."""
    for name in ("time", "monotonic", "perf_counter"):
        seconds, nanoseconds = getattr(time, name), getattr(time, f"{name}_ns")
        setattr(time, name, lambda read=seconds: read() + LATER_S)
        setattr(time, f"{name}_ns", lambda read=nanoseconds: read() + int(LATER_S * 1e9))
    for name in ("gmtime", "localtime"):
        setattr(time, name, _of_now(getattr(time, name)))
    datetime.datetime = _later(datetime.datetime, "now", "utcnow", "today")  # type: ignore[misc]
    datetime.date = _later(datetime.date, "today")  # type: ignore[misc]


def _later(real: Any, *names: str) -> Any:
    """A class that passes for `real`, but lives in the future."""
    later = datetime.timedelta(seconds=LATER_S)
    like = type(real)("Like", (type(real),), {"__instancecheck__": lambda cls, value: isinstance(value, real)})
    reads = {name: classmethod(lambda cls, *zone, name=name: getattr(real, name)(*zone) + later) for name in names}
    return like(real.__name__, (real,), reads)


def _of_now(read: Any) -> Any:
    return lambda seconds=None: read(time.time() if seconds is None else seconds)


def serve(*more: str) -> None:
    """Do the jobs whose files are named on stdin, each in a process of its own, and write its exit code to stdout.

    The libraries of `EARLY` and `more` modules are loaded once, before the processes are forked. The answer is written beside the
    job.
    """
    gc.disable()  # loading makes hundreds of thousands of objects that stay
    for name in (*EARLY, *more):
        importlib.import_module(name)
    gc.freeze()
    gc.enable()
    for line in sys.stdin:
        child = os.fork()
        if not child:
            _answer(Path(line.strip()))
        sys.stdout.write(f"{os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])}\n")
        sys.stdout.flush()


def _answer(path: Path) -> None:
    """Do a job and leave the process. Files are opened before the watch begins."""
    answer, error = path.with_name("answer.json").open("w"), path.with_name("error.txt").open("w")
    code = 1
    try:
        job = json.loads(path.read_text())
        os.environ.update(job["environment"])
        if "maker" in job:
            _fill(job)
        else:
            os.chdir(job["elsewhere"])
            fake_clock()
            json.dump(main(job), answer)
        code = 0
    except BaseException:
        error.write(traceback.format_exc())
    answer.close()
    error.close()
    os._exit(code)


def _fill(job: dict[str, Any]) -> None:
    """Fill a store by a maker of `purity_stores`, with the standard output on standard error."""
    os.dup2(2, 1)
    from tests.helpers import purity_stores

    getattr(purity_stores, job["maker"])(Path(job["store"]), Path(job["files"]))


if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[2])
    serve(*sys.argv[1:])
