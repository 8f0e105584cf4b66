"""Execute one task: lease, inputs, stage, output, trace."""

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
from runner.keys import CodeFingerprints, machine_kind, seed_of
from runner.lease import Lease
from runner.modules import Modules
from runner.store import LostError, Store, explain_os
from runner.traces import Trace, failure_path, read_output, write_failure, write_trace

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Job:
    """Task in the form that travels to a worker: keys and paths, never arrays."""

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
    """run even if there is a trace"""


@dataclass(frozen=True)
class WorkerSpec:
    """Store path, codec and hook that a worker needs."""

    store: Path
    codec: str
    worker: str | None
    root: Path
    """root folder of the code"""
    schemas: tuple[str, ...] = ("schemas",)


@dataclass(frozen=True)
class JobResult:
    """Result of a job.

    status is `ran`, `cached` (another run was faster), `busy` (another run executes it), `lost` (an input cannot be read;
    `message` is its artifact digest) or `failed`.
    """

    key: str
    status: str
    output: str = ""
    message: str = ""
    cpu_s: float = 0.0
    wall_s: float = 0.0
    damaged: bool = False


class Context:
    """Private folder that survives a kill, and a progress callback, for long stages."""

    def __init__(self, scratch: Path, progress: Progress) -> None:
        self.scratch, self.progress = scratch, progress


def execute(job: Job, spec: WorkerSpec, store: Store, progress: Progress) -> JobResult:
    """Execute a job; raises nothing but what must stop the process."""
    try:
        lease = Lease(spec.store / "leases" / f"{job.key}.lock")
    except OSError as error:
        return JobResult(job.key, "failed", message=f"the store cannot be written to: {explain_os(error)}")
    if not lease.held:
        return JobResult(job.key, "busy")
    try:
        return _owned(job, spec, store, progress)
    except LostError as lost:
        return JobResult(job.key, "lost", message=lost.digest, damaged=lost.damaged)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # includes SystemExit: a stage that exits fails, and the run continues
        return _failed(job, spec, error)
    finally:
        lease.release()


def _owned(job: Job, spec: WorkerSpec, store: Store, progress: Progress) -> JobResult:
    if not job.force and _is_made(job, spec, store):
        return JobResult(job.key, "cached")
    _forget_peak()
    cpu, wall = _cpu(), time.monotonic()
    seed = seed_of(job.params_tree, job.inputs)
    if spec.worker:
        resolve(spec.worker)(seed, job.threads)
    inputs = store.load_inputs(job.inputs)
    scratch = spec.store / "scratch" / job.key
    more = {} if job.params is None else {"params": job.params}
    if job.wants_ctx:
        scratch.mkdir(parents=True, exist_ok=True)
        more["ctx"] = Context(scratch, progress)
    value = resolve(job.function)(**inputs, **more)
    output = store.put(value, scratch)
    check_sources(job, spec)
    spent, waited = round(_cpu() - cpu, 4), round(time.monotonic() - wall, 4)
    write_trace(spec.store, _trace(job, output, seed, spent, waited))
    if job.wants_ctx:
        shutil.rmtree(scratch, ignore_errors=True)
    return JobResult(job.key, "ran", output, cpu_s=spent, wall_s=waited)


def _is_made(job: Job, spec: WorkerSpec, store: Store) -> bool:
    """Return True when another run has finished the task since the scheduler checked."""
    output = read_output(spec.store, job.key)
    return output is not None and store.state(output) == "ok"


def _trace(job: Job, output: str, seed: int, cpu_s: float, wall_s: float) -> Trace:
    return Trace(
        key=job.key, stage=job.stage, shard=job.shard, function=job.function, output=output, inputs=job.inputs,
        params=job.params_tree, code=job.code, schemas=job.schemas, libraries=job.libraries, threads=job.threads,
        seed=seed, machine=machine_kind(), reason=job.reason, cpu_s=cpu_s, wall_s=wall_s,
        peak_rss_mib=round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1), finished=time.time())


LOADED: dict[str, Stamp] = {}
"""path -> stamp of the source file from which this process loaded a project module (`runner.worker`)"""


def check_sources(job: Job, spec: WorkerSpec) -> None:
    """Compare the code that ran with the code in the key.

    ValueError when they differ, since the output would be stored under a wrong key. An edit that keeps the fingerprint (a
    comment, an unreachable function) is accepted.
    """
    edited = [path for path, before in job.sources if not _is(path, before) or LOADED.get(path, before) != before]
    if not edited:
        return
    mismatched = [path for path, before in job.sources if LOADED.get(path, before) != before and not _is(path, LOADED[path])]
    if mismatched or not _same_code(job, spec):
        raise ValueError(f"{(mismatched or edited)[0]} was edited while the stage ran; its output was dropped, run again")


def _is(path: str, before: Stamp) -> bool:
    return os.path.exists(path) and stamp(path) == tuple(before)


def _same_code(job: Job, spec: WorkerSpec) -> bool:
    """Return True when the code on disk has the fingerprint in the key."""
    codes = CodeFingerprints(Modules(spec.root, schemas=spec.schemas), spec.codec, spec.worker)
    return codes.of(job.function, job.params).digest == job.code


def _failed(job: Job, spec: WorkerSpec, error: BaseException) -> JobResult:
    """Report the failure in one line; the traceback is stored under the key if the disk permits."""
    message = one_line(error)
    try:
        write_failure(spec.store, job.key, job.stage, job.shard, message, traceback.format_exc())
    except OSError as second:
        message += f" (and the traceback could not be written to {failure_path(spec.store, job.key)}: {explain_os(second)})"
    return JobResult(job.key, "failed", message=message)


def one_line(error: BaseException) -> str:
    """Message of an error in one line.

    ValueError and OSError show their text; other errors show their type as well.
    """
    text = explain_os(error) if isinstance(error, OSError) else " ".join(str(error).split())
    if isinstance(error, OSError) and error.filename and str(error.filename) not in text:
        text = f"{text}: {error.filename}"
    return text if text and isinstance(error, (ValueError, OSError)) else f"{type(error).__name__}: {text}"


def _forget_peak() -> None:
    """Reset the peak memory counter.

    Where the system does not support it, the peak covers the process so far.
    """
    with suppress(OSError), open("/proc/self/clear_refs", "w") as counters:
        counters.write("5")


def _cpu() -> float:
    """CPU seconds of this process and of its finished child processes."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime
