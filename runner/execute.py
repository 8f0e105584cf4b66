"""One task from beginning to end, in whatever process: lease, inputs, the stage, output, trace."""

from __future__ import annotations

import os
import resource
import shutil
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runner.codec import resolve
from runner.files import Stamp, stamp
from runner.keys import Codes, machine_kind, seed_of
from runner.lease import Lease
from runner.modules import Modules
from runner.store import LostError, Store, explain_os
from runner.traces import Trace, failure_path, read_output, write_failure, write_trace

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Job:
    """A task as it travels to a worker: keys and paths, never arrays."""

    key: str
    stage: str
    shard: str
    function: str
    params: Any
    params_tree: Any
    inputs: dict[str, str]
    wants_ctx: bool
    code: str
    schemas: dict[str, str]
    libraries: dict[str, str]
    threads: int
    memory_gib: float
    sources: tuple[tuple[str, Stamp], ...]
    reason: str
    force: bool
    """make it again although there is a trace"""


@dataclass(frozen=True)
class Place:
    """Where a worker works."""

    store: Path
    codec: str
    worker: str | None
    root: Path
    """of the code"""
    schemas: tuple[str, ...] = ("schemas",)


@dataclass(frozen=True)
class Done:
    """What became of a job. status: ran; cached (another run was faster); busy (another run is at it); lost (an input cannot
    be read, `message` is its artifact digest); failed.
    """

    key: str
    status: str
    output: str = ""
    message: str = ""
    cpu_s: float = 0.0
    wall_s: float = 0.0
    damaged: bool = False


class Context:
    """What a long stage may use: a private folder that survives a kill, and a way to say how far it is."""

    def __init__(self, scratch: Path, progress: Progress) -> None:
        self.scratch, self.progress = scratch, progress


def execute(job: Job, place: Place, store: Store, progress: Progress) -> Done:
    """Run a job; never raises but for what must stop the process."""
    try:
        lease = Lease(place.store / "leases" / f"{job.key}.lock")
    except OSError as error:
        return Done(job.key, "failed", message=f"the store cannot be written to: {explain_os(error)}")
    if not lease.held:
        return Done(job.key, "busy")
    try:
        return _owned(job, place, store, progress)
    except LostError as lost:
        return Done(job.key, "lost", message=lost.digest, damaged=lost.damaged)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # SystemExit among them: a stage that ends itself fails, and the run goes on
        return _failed(job, place, error)
    finally:
        lease.release()


def _owned(job: Job, place: Place, store: Store, progress: Progress) -> Done:
    if not job.force and _is_made(job, place, store):
        return Done(job.key, "cached")
    _forget_peak()
    cpu, wall = _cpu(), time.monotonic()
    seed = seed_of(job.params_tree, job.inputs)
    if place.worker:
        resolve(place.worker)(seed, job.threads)
    inputs = store.load_inputs(job.inputs)
    scratch = place.store / "scratch" / job.key
    more = {} if job.params is None else {"params": job.params}
    if job.wants_ctx:
        scratch.mkdir(parents=True, exist_ok=True)
        more["ctx"] = Context(scratch, progress)
    value = resolve(job.function)(**inputs, **more)
    output = store.put(value, scratch)
    check_sources(job, place)
    spent, waited = round(_cpu() - cpu, 4), round(time.monotonic() - wall, 4)
    write_trace(place.store, _trace(job, output, seed, spent, waited))
    if job.wants_ctx:
        shutil.rmtree(scratch, ignore_errors=True)
    return Done(job.key, "ran", output, cpu_s=spent, wall_s=waited)


def _is_made(job: Job, place: Place, store: Store) -> bool:
    """Another run has finished the task since the scheduler looked."""
    output = read_output(place.store, job.key)
    return output is not None and store.state(output) == "ok"


def _trace(job: Job, output: str, seed: int, cpu_s: float, wall_s: float) -> Trace:
    return Trace(
        key=job.key, stage=job.stage, shard=job.shard, function=job.function, output=output, inputs=job.inputs,
        params=job.params_tree, code=job.code, schemas=job.schemas, libraries=job.libraries, threads=job.threads,
        seed=seed, machine=machine_kind(), reason=job.reason, cpu_s=cpu_s, wall_s=wall_s,
        peak_rss_mib=round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1), finished=time.time())


LOADED: dict[str, Stamp] = {}
"""path -> stamp of the source that this process has loaded a module of the project from (`runner.worker`)"""


def check_sources(job: Job, place: Place) -> None:
    """Compare the code that ran with the code of the key. ValueError when they differ: the output would be stored under a key that
    is not its own. An edit that leaves the fingerprint as it is (a comment, a function that cannot run) does no harm.
    """
    edited = [path for path, before in job.sources if not _is(path, before) or LOADED.get(path, before) != before]
    if not edited:
        return
    strange = [path for path, before in job.sources if LOADED.get(path, before) != before and not _is(path, LOADED[path])]
    if strange or not _same_code(job, place):
        raise ValueError(f"{(strange or edited)[0]} was edited while the stage ran; its output was dropped, run again")


def _is(path: str, before: Stamp) -> bool:
    return os.path.exists(path) and stamp(path) == tuple(before)


def _same_code(job: Job, place: Place) -> bool:
    """Whether the code on disk has the fingerprint that is in the key."""
    codes = Codes(Modules(place.root, schemas=place.schemas), place.codec, place.worker)
    return codes.of(job.function, job.params).digest == job.code


def _failed(job: Job, place: Place, error: BaseException) -> Done:
    """One clear line; the traceback is kept beside the key when the disk takes it."""
    message = one_line(error)
    try:
        write_failure(place.store, job.key, job.stage, job.shard, message, traceback.format_exc())
    except OSError as second:
        message += f" (and its traceback could not be kept at {failure_path(place.store, job.key)}: {explain_os(second)})"
    return Done(job.key, "failed", message=message)


def one_line(error: BaseException) -> str:
    """Input errors (ValueError, OSError) speak for themselves; anything else is shown with its type."""
    text = explain_os(error) if isinstance(error, OSError) else " ".join(str(error).split())
    if isinstance(error, OSError) and error.filename and str(error.filename) not in text:
        text = f"{text}: {error.filename}"
    return text if text and isinstance(error, (ValueError, OSError)) else f"{type(error).__name__}: {text}"


def _forget_peak() -> None:
    """Count peak memory from here on. Where the system cannot (not Linux, or no right to), it is that of the process so far."""
    with suppress(OSError), open("/proc/self/clear_refs", "w") as counters:
        counters.write("5")


def _cpu() -> float:
    """CPU seconds of this process and of the processes it has waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime
