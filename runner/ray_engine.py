"""Engine that runs batches on a Ray cluster: same stages, same keys, same bytes.

A batch is one Ray task. Ray places it by its resources, and a worker of Ray hands it to a stage process of its own
(`runner.ray_node`). Keys and paths travel to the nodes, code travels once a node as the files that the stages load
(`runner.ray_code`), outputs go to the store, which is a folder that every node sees or a remote. Small reports come back twice a
second while a batch runs.

Ray retries nothing by itself, because the scheduler knows better what is left of a batch: results that have arrived are kept, the
other jobs of a lost node come back as `returned` and are submitted again.
"""

from __future__ import annotations

import os
import pickle
import platform
import shutil
import signal
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType, MappingProxyType
from typing import Any

from runner import ray_node
from runner.engines import MAX_GROWTH_MIB, MAX_JOBS, Message
from runner.execute import Job, JobResult, JobSpec, WorkerSpec
from runner.files import unique
from runner.ray_code import Parcels
from runner.ray_inputs import Inputs
from runner.resources import Resources
from runner.signals import Terminated

MISSING = "--engine ray needs the package ray, which is not installed; run `make setup EXTRA=ray`"
WINDOW = 4
"""batches in flight for each core of the cluster"""
LOOK_S = 5.0
"""interval at which the nodes of the cluster are listed again"""
CONNECT_S = 10.0
END_S = 10.0
"""time in which a batch that was ended must stop, before its Ray worker is killed"""
MAX_LOSSES = 3
"""nodes that may be lost under a job before it counts as the cause"""
SHARE = 0.25
"""part of a GPU for a task that shares it with others that declare GPU_SHARED"""
CARRIED = ("NUMBA_CACHE_DIR", "NUMBA_CACHE_LOCATOR_CLASSES", "MPLCONFIGDIR", "OPENBLAS_CORETYPE")
"""environment variables that stage processes share with the driver; no others travel, since they may hold credentials"""
OBJECT_STORE_BYTES = 100 << 20
"""Ray's object store on a private cluster, which holds the code and nothing else"""
LOOPBACK_ONLY = "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"
"""with 0, Ray binds all servers to 127.0.0.1, on every system"""
AUTHENTICATION = {"RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"}
"""variables by which a user chooses Ray's authentication; without them, a private cluster has a token of its own"""
FOLDER, MAX_PLACE = "afford-ray-", 13
"""prefix of the folder of a private cluster (logs, sockets), and longest path above it: a socket's path has at most 107 bytes"""
MAX_LINE = 160
"""letters of a message of Ray's services that are shown; its logs have the rest"""
LOOPBACK = "127.0.0.1"


class RayError(ValueError):
    """Ray is not installed, or the cluster does not answer; the message says what to do."""


@dataclass
class _Batch:
    jobs: list[Job]
    done: int = 0
    started: int = -1
    ended: set[str] = field(default_factory=set)
    deadline: float = float("inf")
    """time at which the Ray worker is killed, once the batch was ended"""


class RayEngine:
    """Runs batches on the cluster at `address` (host:port, or 'auto'), or on a private one of this machine.

    jobs, memory_gib: cores and memory of a private cluster. RayError when Ray is missing or the cluster does not answer.
    """

    own_placement = True

    def __init__(self, spec: WorkerSpec, offsets: Mapping[str, int] = MappingProxyType({}), address: str | None = None,
                 jobs: int | None = None, memory_gib: float | None = None) -> None:  # fmt: skip
        self._ray = load_ray(address)
        self._spec, self._offsets = spec, dict(offsets)
        self._cluster = Cluster(self._ray, address, jobs, memory_gib)
        self._token = Path("leases") / unique("ray")
        self._parcels = Parcels(spec.root, spec.store / ".cache" / "modules.json", spec.schemas, _modules(spec))
        self._inputs = Inputs(spec.remote, spec.store, spec.session) if spec.remote else None
        self._sent: dict[str, Any] = {}
        self._functions: dict[tuple[Any, ...], Any] = {}
        self._batches: dict[Any, _Batch] = {}
        self._messages: list[Message] = []
        self._losses: Counter[str] = Counter()
        self._suspects: set[str] = set()
        """jobs that were with a lost worker, and so may have stored their output"""
        self._pickled: tuple[JobSpec | None, str, list[Any]] = (None, "", [])
        (spec.store / self._token).parent.mkdir(parents=True, exist_ok=True)
        (spec.store / self._token).touch()
        self._terminated = False
        self._restore: Any = signal.getsignal(signal.SIGTERM)
        if threading.current_thread() is threading.main_thread() and callable(self._restore):
            signal.signal(signal.SIGTERM, self._note_sigterm)

    @property
    def window(self) -> int:
        """Batches that may be in flight; follows the cluster."""
        return max(WINDOW, WINDOW * self._cluster.cores())

    @property
    def folder(self) -> str:
        """Folder of a private cluster, which holds its logs; '' for another one."""
        return self._cluster.folder

    def submit(self, jobs: list[Job], gpus: tuple[str, ...] = ()) -> None:
        """Submit one batch, all of one stage; Ray chooses its GPUs."""
        spec = jobs[0].spec
        options, refusal = self._cluster.place(spec.resources)
        if refusal:
            self._messages += [("done", job.key, JobResult(job.key, "failed", message=refusal)) for job in jobs]
            return
        if self._inputs is not None:
            self._inputs.push(jobs)
        digest, parcel = self._code(spec)
        suspects = self._suspects and {job.key for job in jobs if job.key in self._suspects}
        stream = self._function(options).remote(digest, parcel, pickle.dumps((jobs, suspects), 5), len(jobs))
        self._batches[stream] = _Batch(jobs)

    def wait(self, timeout_s: float | None) -> list[Message]:
        """Return the news of all batches; empty only after the timeout, or when none is in flight."""
        try:
            self._receive(float("inf") if timeout_s is None else time.monotonic() + timeout_s)
        except KeyboardInterrupt:
            if self._terminated:
                raise Terminated from None  # Ray raises KeyboardInterrupt for every signal
            raise
        found, self._messages = self._messages, []
        return found

    def _receive(self, end: float) -> None:
        """Read reports until there is a message, or until a time on the monotonic clock."""
        while not self._messages and self._batches:
            left = max(0.0, min(end - time.monotonic(), 1.0))
            ready, _ = self._ray.wait(list(self._batches), num_returns=1, timeout=left, fetch_local=False)
            if ready:
                ready, _ = self._ray.wait(list(self._batches), num_returns=len(self._batches), timeout=0, fetch_local=False)
            for stream in ready:
                self._read(stream)
            self._kill_late()
            if time.monotonic() >= end:
                break

    def end(self, key: str) -> None:
        """Stop a job with the stage process that runs it; the unfinished jobs of its batch come back as `returned`."""
        for stream, batch in self._batches.items():
            if key in {job.key for job in batch.jobs[batch.done :]}:
                batch.ended.add(key)
                batch.deadline = min(batch.deadline, time.monotonic() + END_S)
                self._ray.cancel(stream, force=False)
        self._messages = [message for message in self._messages if message[1] != key]

    def close(self) -> None:
        """Stop all batches and leave the cluster; a private one ends. Finished results are kept."""
        for stream in self._batches:
            self._ray.cancel(stream, force=False)
        end = time.monotonic() + END_S
        while self._batches and time.monotonic() < end:
            self.wait(0.1)
            self._messages.clear()
        self._batches.clear()
        self._sent.clear()
        self._pickled = (None, "", [])
        (self._spec.store / self._token).unlink(missing_ok=True)
        self._cluster.leave()
        if signal.getsignal(signal.SIGTERM) == self._note_sigterm:
            signal.signal(signal.SIGTERM, self._restore)

    def _note_sigterm(self, number: int, frame: FrameType | None) -> None:
        self._terminated = True
        self._restore(number, frame)

    # -- what travels ------------------------------------------------------------------------------------------------

    def _function(self, options: tuple[tuple[str, Any], ...]) -> Any:
        """Remote function with these resources."""
        if options not in self._functions:
            self._ray.cloudpickle.register_pickle_by_value(ray_node)
            named = {name: dict(value) if name == "resources" else value for name, value in options}
            self._functions[options] = self._ray.remote(ray_node.run_batch).options(
                num_returns="streaming", max_retries=0, name="batch", **named)
        return self._functions[options]

    def _code(self, spec: JobSpec) -> tuple[str, list[Any]]:
        """Digest of the parcel that holds the code of a stage, and a list with the reference to it."""
        if self._pickled[0] is not spec:
            parcel = self._parcels.of(f"{self._spec.root}/{source.path}" for source in spec.sources)
            if parcel.digest not in self._sent:
                self._sent[parcel.digest] = self._ray.put((self.setting(), parcel.files, parcel.data))
            self._pickled = spec, parcel.digest, [self._sent[parcel.digest]]
        return self._pickled[1:]

    def setting(self) -> dict[str, Any]:
        """Settings from which a node starts a stage process, in plain types."""
        spec = self._spec
        return {"root": str(spec.root), "engine": str(Path(__file__).resolve().parent.parent), "store": str(spec.store),
                "token": str(self._token), "codec": spec.codec, "worker": spec.worker, "schemas": list(spec.schemas),
                "remote": spec.remote, "session": spec.session, "owner": spec.owner, "python": platform.python_version(),
                "offsets": {} if spec.remote else self._offsets, "max_jobs": MAX_JOBS, "max_growth_mib": MAX_GROWTH_MIB,
                "environment": {name: os.environ[name] for name in CARRIED if name in os.environ}}

    # -- what comes back ---------------------------------------------------------------------------------------------

    def _read(self, stream: Any) -> None:
        """Take the next report of a batch, or its end."""
        batch = self._batches[stream]
        try:
            running, done, progress, died, refused = self._ray.get(next(stream))
        except StopIteration:
            self._finish(stream, "returned", "")
            return
        except self._ray.exceptions.TaskCancelledError:
            self._finish(stream, "returned", "")
            return
        except self._ray.exceptions.RayError as error:
            self._finish(stream, *self._lost(batch, error))
            return
        for result in done:
            self._done(batch, JobResult(*pickle.loads(result)))
        if died or refused:
            self._finish(stream, "died" if died else "failed", died or refused)
        elif batch.done == len(batch.jobs):
            del self._batches[stream]
        else:
            self._running(batch, running, progress)

    def _done(self, batch: _Batch, result: JobResult) -> None:
        self._started(batch)
        if self._inputs is not None and result.status == "lost":
            self._inputs.forget(batch.jobs[batch.done])
        if result.key not in batch.ended:
            self._messages.append(("done", result.key, result))
        batch.done += 1

    def _started(self, batch: _Batch) -> None:
        """Report that the first job without result has started, once."""
        if batch.started < batch.done:
            batch.started = batch.done
            key = batch.jobs[batch.done].key
            if key not in batch.ended:
                self._messages.append(("started", key, None))

    def _running(self, batch: _Batch, running: int, progress: tuple[int, ...]) -> None:
        if running >= 0:
            self._started(batch)
        key = batch.jobs[batch.done].key
        if progress and key not in batch.ended:
            self._messages.append(("progress", key, progress))

    def _finish(self, stream: Any, status: str, message: str) -> None:
        """End a batch: its first unfinished job gets this status, the others come back; `failed` is for all of them."""
        batch = self._batches.pop(stream)
        if status == "died":
            self._started(batch)
        for place, job in enumerate(batch.jobs[batch.done :]):
            own = status if place == 0 or status == "failed" else "returned"
            if job.key not in batch.ended:
                self._messages.append(("done", job.key, JobResult(job.key, own, message=message if own == status else "")))

    def _lost(self, batch: _Batch, error: Exception) -> tuple[str, str]:
        """Status and message of the job that ran when Ray lost its worker.

        The node is the usual cause, and so the job is blamed only after several losses, or when Ray ended it for its memory.
        """
        if batch.done == len(batch.jobs):
            return "returned", ""
        self._suspects |= {job.key for job in batch.jobs[batch.done :]}
        key = batch.jobs[batch.done].key
        self._losses[key] += 1
        first = _first_line(error)
        if isinstance(error, self._ray.exceptions.OutOfMemoryError):
            return "died", f"Ray ended the worker because the node ran out of memory: raise MEMORY_GIB of the stage ({first})"
        if isinstance(error, self._ray.exceptions.RayTaskError):
            return "failed", f"the Ray worker failed: {first}"
        if self._losses[key] >= MAX_LOSSES:
            return "died", f"the Ray worker was lost {MAX_LOSSES} times while this task ran ({first})"
        return "returned", ""

    def _kill_late(self) -> None:
        """Kill the Ray workers of batches that were ended and did not stop."""
        now = time.monotonic()
        for stream, batch in self._batches.items():
            if batch.deadline <= now:
                batch.deadline = float("inf")
                self._ray.cancel(stream, force=True)


class Cluster:
    """Connection to a cluster, and what its nodes have. A private cluster lives as long as the connection."""

    def __init__(self, ray: Any, address: str | None, jobs: int | None, memory_gib: float | None) -> None:
        self._ray, self.folder = ray, ""
        self._nodes: list[dict[str, float]] = []
        self._looked = float("-inf")
        self._ours = not ray.is_initialized()
        if self._ours and address is None:
            self.folder = _private_folder()
            memory = {} if memory_gib is None else {"_memory": int(memory_gib * 2**30)}
            self._init(address="local", num_cpus=jobs, object_store_memory=OBJECT_STORE_BYTES, include_dashboard=False,
                       _temp_dir=str(Path(self.folder) / "r"), **memory)
        elif self._ours:
            _check_address(address or "auto")
            self._init(address=address)

    def cores(self) -> int:
        """Cores of all nodes that are alive."""
        self._look()
        return int(sum(node.get("CPU", 0) for node in self._nodes))

    def place(self, needs: Resources) -> tuple[tuple[tuple[str, Any], ...], str]:
        """Resources to request for a job, at most those of the best node; and why no node can run it ('': one can)."""
        self._look()
        able = [node for node in self._nodes if node.get("GPU", 0) >= needs.gpus and node["CPU"] > 0]
        if not able:
            lacking = f"{needs.gpus} GPU" if needs.gpus else "a core"
            return (), f"no node of the Ray cluster has {lacking} for this stage; add one, or select a backend that needs none"
        memory = needs.memory_gib * 2**30
        best = max(able, key=lambda node: (node["CPU"] >= needs.threads and node["memory"] >= memory, node["CPU"], node["memory"]))
        options: dict[str, Any] = {
            "num_cpus": min(needs.threads, best["CPU"]), "memory": int(min(memory, best["memory"])) or None}
        if needs.gpus:
            options["num_gpus"] = SHARE if needs.gpu_shared and needs.gpus == 1 else needs.gpus
        if needs.scratch_gib and best.get("scratch_gib"):
            options["resources"] = (("scratch_gib", min(needs.scratch_gib, best["scratch_gib"])),)
        return tuple(options.items()), ""

    def leave(self) -> None:
        """Disconnect, unless the connection was there before; a private cluster ends."""
        if self._ours:
            self._ray.shutdown()
        if self.folder:
            shutil.rmtree(self.folder, ignore_errors=True)

    def _look(self) -> None:
        if time.monotonic() - self._looked > LOOK_S or not self._nodes:
            self._nodes = [{"CPU": 0.0, "memory": 0.0, **node["Resources"]} for node in self._ray.nodes() if node["Alive"]]
            self._looked = time.monotonic()

    def _init(self, **options: Any) -> None:
        try:
            with _kept_signals():
                self._ray.init(log_to_driver=False, logging_level="ERROR", configure_logging=False, **options)
        except (ConnectionError, RuntimeError, ValueError) as error:
            raise RayError(f"Ray cannot start, or join the cluster at {options['address']}: {_first_line(error)}") from error
        self._ray._private.worker.print_to_stdstream = _to_stderr  # Ray would print the loss of a node to stdout, at length
        if self.folder and self._ray.util.get_node_ip_address() != LOOPBACK:
            self.leave()
            raise RayError("Ray was imported before the engine, and would listen on all networks; do not import it, or set "
                           "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER=0 before the import")


def load_ray(address: str | None) -> Any:
    """Import Ray; RayError when it is not installed, or the address is not that of a cluster."""
    if address is not None and address.startswith("ray://"):
        raise RayError(f"--address {address}: Ray's client is not supported; run on a node of the cluster, with HOST:PORT")
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    if address is None and "ray" not in sys.modules and not AUTHENTICATION & os.environ.keys():
        os.environ["RAY_AUTH_MODE"], os.environ["RAY_AUTH_TOKEN"] = "token", os.urandom(24).hex()
    if address is None or address.startswith((LOOPBACK, "localhost")):
        os.environ[LOOPBACK_ONLY] = "0"  # Ray would otherwise take the name of this machine's network for it
    try:
        import ray
    except ModuleNotFoundError:
        raise RayError(MISSING) from None
    return ray


def _check_address(address: str) -> None:
    """Raise RayError when nothing listens at HOST:PORT; Ray itself would try for minutes."""
    host, _, port = address.rpartition(":")
    if address == "auto":
        return
    if not host or not port.isdigit():
        raise RayError(f"--address {address}: expected HOST:PORT of a Ray cluster, or auto")
    try:
        socket.create_connection((host, int(port)), CONNECT_S).close()
    except OSError as error:
        raise RayError(f"no Ray cluster answers at {address} ({error.strerror or error}); start one with `ray start`, or correct "
                       "--address") from error


def _private_folder() -> str:
    """Make a folder for the files of a private cluster, closed to other users, and remove those of drivers that were killed."""
    place = tempfile.gettempdir() if len(tempfile.gettempdir()) <= MAX_PLACE else "/tmp"
    for old in Path(place).glob(f"{FOLDER}*-*"):
        owner = old.name.removeprefix(FOLDER).partition("-")[0]
        if old.stat().st_uid == os.getuid() and not _alive(int(owner)):
            shutil.rmtree(old, ignore_errors=True)
    return tempfile.mkdtemp(prefix=f"{FOLDER}{os.getpid()}-", dir=place)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@contextmanager
def _kept_signals() -> Iterator[None]:
    """Restore the handler of SIGTERM, which Ray replaces by its own."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        yield
    finally:
        with suppress(ValueError):  # not the main thread: Ray did not replace it either
            signal.signal(signal.SIGTERM, before)


def _to_stderr(data: dict[str, Any], ignore_prefix: bool) -> None:
    """Print the start of a message of Ray's own services."""
    for line in data["lines"]:
        sys.stderr.write(f"ray: {line.strip().partition(chr(10))[0][:MAX_LINE]}\n")


def _modules(spec: WorkerSpec) -> list[str]:
    """Modules that every stage process loads."""
    return [reference.partition(":")[0] for reference in (spec.codec, spec.worker) if reference]


def _first_line(error: Exception) -> str:
    return str(error).strip().partition("\n")[0]
