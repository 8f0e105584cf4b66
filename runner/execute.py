"""Execute one task: lease, inputs, stage, output, trace."""

from __future__ import annotations

import os
import resource
import shutil
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from runner.canonical import digest, file_digest
from runner.codec import resolve
from runner.files import Source, Stamp, stamp
from runner.index import Manifest, artifact_row
from runner.keys import CodeFingerprints, machine_kind, seed_of
from runner.lease import KeyLeases
from runner.memory import PeakMeter
from runner.modules import Modules
from runner.resources import Resources
from runner.segments import OtherRuns, SegmentWriter, body_of, encode
from runner.store import LostError, Store, explain_os

if TYPE_CHECKING:
    from runner.sharing import SharedTasks

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class JobSpec:
    """Part of a job that all shards of a stage share; it travels to a worker once per batch."""

    stage: str
    function: str
    params: Any
    params_tree: Any
    wants_ctx: bool
    code: str
    libraries: dict[str, str]
    threads: int
    resources: Resources
    timeout_s: float
    """the shard fails after so long without progress; 0 for no limit"""
    machine: str
    """kind of machine, for stages that declare MACHINE; '' for all others"""
    sources: tuple[Source, ...]

    @cached_property
    def row(self) -> list[Any]:
        """Row of a segment: what the traces of the stage share."""
        tree = {"function": self.function, "params": self.params_tree, "code": self.code, "libraries": self.libraries,
                "threads": self.threads, "machine": machine_kind()}
        return ["spec", digest("afford-trace-spec", tree), tree]


@dataclass(frozen=True)
class Job:
    """Task in the form that travels to a worker: keys and paths, never arrays."""

    spec: JobSpec
    key: str
    shard: str
    inputs: dict[str, str]
    schemas: dict[str, str]
    manifests: dict[str, str]
    """encoded manifests of the inputs and of their parts"""
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
    remote: str | None = None
    session: str = ""
    """name of the run, with which the names of its segments begin"""
    owner: str = ""
    """name under which the run claims keys in the remote store"""


@dataclass(frozen=True)
class JobResult:
    """Result of a job.

    status is `ran`, `cached` (another run was faster), `busy` (another run executes it), `lost` (an input cannot be read;
    `message` lists artifact digests), `failed`, `died` (the worker process ended during the job) or `returned` (the job was not
    started because its worker ended).
    """

    key: str
    status: str
    output: str = ""
    message: str = ""
    cpu_s: float = 0.0
    wall_s: float = 0.0
    peak_mib: float = 0.0
    rows: bytes = b""
    """rows that the worker has appended to `segment` at byte `start`; without a segment, to another store"""
    segment: str = ""
    start: int = 0


class JobCatalog:
    """Manifests of one job: those of its inputs, and those of its output, which become rows of a segment."""

    def __init__(self, others: Mapping[str, str]) -> None:
        self._bodies: dict[str, str] = {}
        self._others = others
        self.rows: list[bytes] = []

    def begin(self, manifests: dict[str, str]) -> None:
        """Take the manifests of a job's inputs."""
        self._bodies, self.rows = dict(manifests), []

    def body(self, digest: str) -> str | None:
        """Encoded manifest; None for an unknown artifact."""
        return self._bodies.get(digest) or self._others.get(digest)

    def has_artifact(self, digest: str) -> bool:
        """Return True for an artifact of this job; what other runs have stored may be unknown to the scheduler."""
        return digest in self._bodies

    def add_artifact(self, digest: str, manifest: Manifest) -> None:
        """Record an artifact of the output."""
        row = artifact_row(digest, manifest)
        self._bodies[digest] = body_of(*row[2:])
        self.rows.append(encode(row))


class Workplace:
    """Tools of a process that executes jobs: the store, its segment, leases on keys, and the results of other runs."""

    def __init__(self, spec: WorkerSpec, offsets: Mapping[str, int] = MappingProxyType({})) -> None:
        self.spec, self.others = spec, OtherRuns(spec.store, spec.session, offsets)
        self.catalog = JobCatalog(self.others.bodies)
        self.shared = None if spec.remote is None else _shared(spec)
        self.store = Store(spec.store, resolve(spec.codec), self.catalog, remote=self.shared.remote if self.shared else None)
        self.leases, self.segment, self.meter = KeyLeases(spec.store), SegmentWriter(spec.store, spec.session), PeakMeter()
        self._specs: tuple[str, set[str]] = ("", set())
        """segment, and digests of the specs that it holds"""

    def append(self, job: Job, rows: list[bytes]) -> tuple[bytes, str, int]:
        """Write rows of a job, and before them its spec where the segment lacks it; return rows, segment and offset."""
        spec = job.spec.row
        if self._specs[0] != self.segment.name or spec[1] not in self._specs[1]:
            rows = [encode(spec), *rows]
        data = b"".join(rows)
        start = self.segment.append(data)
        if self._specs[0] != self.segment.name:
            self._specs = self.segment.name, set()
        self._specs[1].add(spec[1])
        return data, self.segment.name, start

    def close(self) -> None:
        """Close the segment, release the leases, and remove the folder in which values were saved."""
        self.segment.close()
        self.leases.close()
        self.store.clean()


def _shared(spec: WorkerSpec) -> SharedTasks:
    from runner.sharing import SharedTasks

    return SharedTasks(spec.remote or "", spec.store, spec.session, spec.owner)


class Context:
    """Private folder that survives a kill, and a progress callback, for long stages."""

    def __init__(self, scratch: Path, progress: Progress) -> None:
        self.scratch, self.progress = scratch, progress


def execute(job: Job, place: Workplace, progress: Progress) -> JobResult:
    """Execute a job; raises nothing but what must stop the process."""
    try:
        if not place.leases.acquire(job.key):
            return JobResult(job.key, "busy")
    except OSError as error:
        return JobResult(job.key, "failed", message=f"the store cannot be written to: {explain_os(error)}")
    try:
        return _claimed(job, place, progress) if place.shared else _owned(job, place, progress)
    except LostError as lost:
        return JobResult(job.key, "lost", message=" ".join((lost.digest, *lost.also)))
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # includes SystemExit: a stage that exits fails, and the run continues
        return _failed(job, place, error)
    finally:
        place.leases.release(job.key)


def _claimed(job: Job, place: Workplace, progress: Progress) -> JobResult:
    """Execute a job whose key no other host has claimed, and push its result."""
    assert place.shared is not None
    state = place.shared.acquire(job.key, again=job.force or job.reason.startswith("output "))
    if state != "held":
        return JobResult(job.key, "busy" if state == "busy" else "cached")
    rows = b""
    try:
        result = _owned(job, place, progress)
        rows = result.rows if result.status == "ran" else b""
    finally:
        place.shared.release(job.key, rows)
    return result


def _owned(job: Job, place: Workplace, progress: Progress) -> JobResult:
    spec, store = job.spec, place.store
    if not job.force and (made := place.others.output(job.key)) is not None:
        store.renew()
        if store.state(made) == "ok":
            return JobResult(job.key, "cached")
    place.catalog.begin(job.manifests)
    place.meter.start()
    cpu, wall = _cpu(), time.monotonic()
    seed = seed_of(spec.params_tree, job.inputs)
    if place.spec.worker:
        resolve(place.spec.worker)(seed, spec.threads)
    if store.remote is not None:
        store.fetch(job.inputs.values())
    inputs = store.load_inputs(job.inputs)
    scratch = place.spec.store / "scratch" / job.key
    more = {} if spec.params is None else {"params": spec.params}
    if spec.wants_ctx:
        scratch.mkdir(parents=True, exist_ok=True)
        more["ctx"] = Context(scratch, progress)
    value = resolve(spec.function)(**inputs, **more)
    output = store.put(value, scratch)
    check_sources(job, place.spec)
    spent, waited, peak = round(_cpu() - cpu, 4), round(time.monotonic() - wall, 4), place.meter.peak_mib()
    trace = ["trace", job.key, output, spec.row[1], spec.stage, job.shard, job.inputs, job.schemas, seed, job.reason, spent, waited,
             peak, round(time.time(), 6)]
    rows, segment, start = place.append(job, [*place.catalog.rows, encode(trace)])
    if spec.wants_ctx:
        shutil.rmtree(scratch, ignore_errors=True)
    return JobResult(job.key, "ran", output, cpu_s=spent, wall_s=waited, peak_mib=peak, rows=rows, segment=segment, start=start)


LOADED: dict[str, tuple[Stamp, str]] = {}
"""path -> stamp and content of the source file from which this process loaded a project module (`runner.worker`)"""
_CONTENTS: dict[str, tuple[Stamp, str]] = {}
"""path -> stamp and content of a source file when it was compared last"""


def check_sources(job: Job, spec: WorkerSpec) -> None:
    """Compare the code that ran with the code in the key.

    ValueError when they differ, since the output would be stored under a wrong key. An edit that keeps the fingerprint (a
    comment, an unreachable function) is accepted. Files are compared by content where their stamps differ, as on another host.
    """
    edited = mismatched = ""
    for source in job.spec.sources:
        path = f"{spec.root}/{source.path}"
        loaded = LOADED.get(path)
        same = _is(path, source)
        if loaded is not None and loaded[0] != source.stamp and loaded[1] != source.content:
            mismatched = mismatched or ("" if _is_now(path, loaded) else path)
            same = False
        edited = edited or ("" if same else path)
    if edited and (mismatched or not _same_code(job, spec)):
        raise ValueError(f"{mismatched or edited} was edited while the stage ran; its output was dropped, run again")


def _is(path: str, source: Source) -> bool:
    """Return True when a file has the content of a source."""
    try:
        now = stamp(path)
    except FileNotFoundError:
        return False
    return now == source.stamp or _content(path, now) == source.content


def _is_now(path: str, loaded: tuple[Stamp, str]) -> bool:
    """Return True when a file still has the content that was loaded."""
    return os.path.exists(path) and _content(path, stamp(path)) == loaded[1]


def _content(path: str, now: Stamp) -> str:
    known = _CONTENTS.get(path)
    if known is None or known[0] != now:
        known = _CONTENTS[path] = now, file_digest(Path(path))
    return known[1]


def _same_code(job: Job, spec: WorkerSpec) -> bool:
    """Return True when the code on disk has the fingerprint in the key."""
    codes = CodeFingerprints(Modules(spec.root, schemas=spec.schemas), spec.codec, spec.worker)
    return codes.of(job.spec.function, job.spec.params).digest == job.spec.code


def _failed(job: Job, place: Workplace, error: BaseException) -> JobResult:
    """Report the failure in one line; the traceback is stored under the key if the disk permits."""
    message = one_line(error)
    row = ["failure", job.key, job.spec.stage, job.shard, message, traceback.format_exc(), time.time()]
    try:
        rows, segment, start = place.append(job, [encode(row)])
    except OSError as second:
        message += f" (and the traceback could not be written to the store: {explain_os(second)})"
        return JobResult(job.key, "failed", message=message)
    return JobResult(job.key, "failed", message=message, rows=rows, segment=segment, start=start)


def one_line(error: BaseException) -> str:
    """Message of an error in one line.

    ValueError and OSError show their text; other errors show their type as well.
    """
    text = explain_os(error) if isinstance(error, OSError) else " ".join(str(error).split())
    if isinstance(error, OSError) and error.filename and str(error.filename) not in text:
        text = f"{text}: {error.filename}"
    return text if text and isinstance(error, (ValueError, OSError)) else f"{type(error).__name__}: {text}"


def _cpu() -> float:
    """CPU seconds of this process and of its finished child processes."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime
