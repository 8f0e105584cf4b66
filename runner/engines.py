"""Engines that execute jobs: submit a batch, wait for messages, close. Keys and paths travel, never arrays."""

from __future__ import annotations

import math
import os
import select
import signal as signals
import time
from collections import deque
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol

from runner.execute import Job, JobResult, WorkerSpec, Workplace, execute
from runner.modules import outdated

if TYPE_CHECKING:
    from runner.worker_process import WorkerProcess

Message = tuple[str, str, Any]
"""('started', key, None), ('progress', key, (done, total)) or ('done', key, JobResult)"""
MAX_JOBS = 20_000
"""jobs of a worker before it is replaced: what a library loses in every call stays small, and a new process, with its imports,
costs under 1 % of the time of so many jobs"""
MAX_GROWTH_MIB = 2048.0
"""growth of a worker since its first batch before it is replaced; the largest libraries take a quarter of it"""


LONGEST_S = 86400.0
"""longest single wait; poll counts milliseconds in 32 bits"""
NO_PROGRESS = "the task made no progress for {:g} s and was stopped; raise TIMEOUT_S of the stage, or report progress through ctx"


class Engine(Protocol):
    """Executes batches of jobs."""

    own_placement: bool
    """True if the engine places tasks by their resources itself; the scheduler then bounds the batches in flight by `window`"""
    window: int

    def submit(self, jobs: list[Job], gpus: tuple[str, ...] = ()) -> None:
        """Start a batch of jobs of one stage, which one worker executes in order.

        `gpus` are those that the worker may see (`Grant.visible`); empty: all. An engine with its own placement ignores them.
        """

    def wait(self, timeout_s: float | None) -> list[Message]:
        """Return new messages, at least one unless the time is over or no job is in flight."""

    def end(self, key: str) -> None:
        """Stop a submitted job; no further message reports it, and the rest of its batch is returned."""

    def close(self) -> None:
        """Stop running jobs; finished results are kept."""


class Inline:
    """Executes jobs in this process, one after the other, during `wait`. TIMEOUT_S and GPUS have no effect here."""

    own_placement, window = False, 1

    def __init__(self, spec: WorkerSpec, offsets: Mapping[str, int] = MappingProxyType({})) -> None:
        self._place = Workplace(spec, offsets)
        self._jobs: deque[Job] = deque()
        self._announced = ""
        """key of the first job, once its start is reported"""

    def submit(self, jobs: list[Job], gpus: tuple[str, ...] = ()) -> None:
        """Queue the jobs for `wait`."""
        self._jobs += jobs

    def wait(self, timeout_s: float | None) -> list[Message]:
        """Execute the job whose start was reported, and report the start of the next one."""
        messages = self._run(self._jobs.popleft()) if self._jobs and self._jobs[0].key == self._announced else []
        if self._jobs:
            self._announced = self._jobs[0].key
            messages.append(("started", self._announced, None))
        return messages

    def _run(self, job: Job) -> list[Message]:
        root, messages = self._place.spec.root, list[Message]()
        old = outdated(f"{root}/{source.path}" for source in job.spec.sources)
        if old is not None:
            message = f"{old} was edited after this process imported it; run again in a new process, or with --jobs 1"
            return [("done", job.key, JobResult(job.key, "failed", message=message))]
        done = execute(job, self._place, lambda n, of: messages.append(("progress", job.key, (n, of))))
        return [*messages, ("done", job.key, done)]

    def end(self, key: str) -> None:
        """Remove a queued job; a running one cannot be stopped in-process."""
        self._jobs = deque(job for job in self._jobs if job.key != key)

    def close(self) -> None:
        """Close the segment and remove the folder in which values were saved; no job runs outside `wait`."""
        self._place.close()


class Pool:
    """Worker processes, started on demand and kept for later batches.

    A worker that dies fails the job that it ran, and one that makes no progress for TIMEOUT_S is killed; the other jobs of the
    batch are returned. Workers that have run many jobs, or have grown, are replaced between two batches.
    """

    own_placement, window = False, os.cpu_count() or 1

    def __init__(self, spec: WorkerSpec, offsets: Mapping[str, int] = MappingProxyType({}), max_jobs: int = MAX_JOBS,
                 max_growth_mib: float = MAX_GROWTH_MIB) -> None:
        self._spec, self._offsets = spec, dict(offsets)
        self._max_jobs, self._max_growth_mib = max_jobs, max_growth_mib
        self._workers: list[WorkerProcess] = []
        self._leaving: list[WorkerProcess] = []
        self._queue: list[Message] = []

    def submit(self, jobs: list[Job], gpus: tuple[str, ...] = ()) -> None:
        """Send a batch to an idle worker with these GPUs, rather one that has loaded the inputs or the stage, or to a new one."""
        self._retire(gpus)
        wanted, function = set(jobs[0].inputs.values()), jobs[0].spec.function
        idle = [worker for worker in self._workers if not worker.batch and worker.gpus == gpus]
        worker = max(idle, key=lambda one: (len(wanted & one.loaded), one.function == function), default=None)
        if worker is None:
            from runner.worker_process import WorkerProcess  # not for a run with nothing to do

            worker = WorkerProcess(self._spec, self._offsets, gpus)
            self._workers.append(worker)
        worker.submit(jobs)

    def wait(self, timeout_s: float | None) -> list[Message]:
        """Return the messages of all workers; blocks until there are some, or until the time is over."""
        end = float("inf") if timeout_s is None else time.monotonic() + timeout_s
        while not self._queue and any(worker.batch for worker in self._workers):
            self._poll(min(end, *(worker.deadline() for worker in self._workers)) - time.monotonic())
            if time.monotonic() >= end:
                break
        found, self._queue = self._queue, []
        return found

    def end(self, key: str) -> None:
        """Kill the worker that runs the job, which also releases its lease; the stage's scratch folder is kept."""
        for worker in [worker for worker in self._workers if key in worker.batch]:
            self._workers.remove(worker)
            self._queue += worker.end().messages
            self._queue += [("done", other, JobResult(other, "returned")) for other in worker.batch]
        self._queue = [message for message in self._queue if message[1] != key]

    def close(self) -> None:
        """End idle workers; kill busy ones, which also releases their leases."""
        for worker in self._workers:
            if worker.batch:
                worker.end()
            else:
                self._leave(worker)
        self._workers.clear()
        for worker in self._leaving:
            worker.is_gone(wait=True)
        self._leaving.clear()

    def _poll(self, seconds: float) -> None:
        """Wait for any worker, queue messages, and bury workers that have ended or are over their time."""
        poll = select.poll()
        owners: dict[int, WorkerProcess] = {}
        for worker in self._workers:
            owners |= dict.fromkeys(worker.register(poll), worker)
        ready = poll.poll(None if seconds == float("inf") else max(0, math.ceil(1000 * min(seconds, LONGEST_S))))
        for worker in dict.fromkeys(owners[fd] for fd, _ in ready):
            worker.channel.push()
            self._queue += worker.messages()
            if worker.has_ended():
                self._bury(worker)
        now = time.monotonic()
        for worker in [worker for worker in self._workers if worker.deadline() <= now]:
            self._queue += worker.messages()
            if worker.deadline() <= now:  # it was not this process that made no progress
                self._bury(worker, in_time=False)

    def _bury(self, worker: WorkerProcess, in_time: bool = True) -> None:
        """Report the jobs of a worker that has died, or that is killed because it made no progress."""
        self._workers.remove(worker)
        limit_s = next((job.spec.timeout_s for job in worker.batch.values()), 0.0)
        ended = worker.end()
        self._queue += ended.messages
        status, message = ("died", _death(ended.status)) if in_time else ("failed", NO_PROGRESS.format(limit_s))
        blamed = {ended.running}
        if ended.fresh and worker.batch:  # it could not even start: every job is blamed, so that no job is returned for ever
            blamed = set(worker.batch) if in_time else {next(iter(worker.batch))}
        for key in worker.batch:
            result = JobResult(key, status, message=message) if key in blamed else JobResult(key, "returned")
            self._queue.append(("done", key, result))

    def _retire(self, gpus: tuple[str, ...]) -> None:
        """End idle workers that are due to be replaced, or hold some of the GPUs in another combination."""
        self._leaving = [worker for worker in self._leaving if not worker.is_gone()]
        for worker in [worker for worker in self._workers if not worker.batch]:
            grown_mib = worker.resident_mib - worker.first_mib
            if (worker.finished >= self._max_jobs or grown_mib > self._max_growth_mib
                    or (worker.gpus != gpus and set(worker.gpus) & set(gpus))):
                self._workers.remove(worker)
                self._leave(worker)

    def _leave(self, worker: WorkerProcess) -> None:
        worker.leave()
        self._leaving.append(worker)


def _death(status: int) -> str:
    """Describe the end of a worker process, from its exit status."""
    names = {signal.value: signal.name for signal in signals.Signals}
    how = f"signal {names.get(-status, -status)}" if status < 0 else f"exit status {status}"
    hint = "; the usual cause is lack of memory: raise MEMORY_GIB of the stage or lower --jobs" if status == -9 else ""
    return f"the worker process ended with {how} before the task was done{hint}"
