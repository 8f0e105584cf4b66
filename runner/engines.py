"""Engines that execute jobs: submit a job, wait for messages, close. Keys and paths travel, never arrays."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from socket import socketpair
from types import MappingProxyType
from typing import Any, Protocol

from runner.execute import Job, JobResult, WorkerSpec, Workplace, execute
from runner.modules import outdated

Message = tuple[str, str, Any]
"""('started', key, None), ('progress', key, (done, total)) or ('done', key, JobResult)"""


class Engine(Protocol):
    """Executes batches of jobs."""

    own_placement: bool
    """True if the engine places tasks by their resources itself; the scheduler then bounds the batches in flight by `window`"""
    window: int

    def submit(self, jobs: list[Job], gpus: tuple[str, ...] = ()) -> None:
        """Start a batch of jobs of one stage, which one worker executes in order; `gpus` are those that it may see."""

    def wait(self, timeout_s: float | None) -> list[Message]:
        """Return new messages, at least one unless the time is over."""

    def end(self, key: str) -> None:
        """Stop a submitted job; no further message reports it, and the rest of its batch is returned."""

    def close(self) -> None:
        """Stop running jobs; finished results are kept."""


class Inline:
    """Executes jobs in this process, one after the other, during `wait`."""

    own_placement, window = False, 1

    def __init__(self, spec: WorkerSpec, offsets: Mapping[str, int] = MappingProxyType({})) -> None:
        self._place = Workplace(spec, offsets)
        self._jobs: deque[Job] = deque()

    def submit(self, jobs: list[Job], gpus: tuple[str, ...] = ()) -> None:
        """Queue the jobs for `wait`."""
        self._jobs += jobs

    def wait(self, timeout_s: float | None) -> list[Message]:
        """Execute the next job."""
        if not self._jobs:
            return []
        job = self._jobs.popleft()
        messages: list[Message] = [("started", job.key, None)]
        root = self._place.spec.root
        old = outdated(f"{root}/{source.path}" for source in job.spec.sources)
        if old is not None:
            message = f"{old} was edited after this process imported it; run again in a new process, or with --jobs 1"
            return [*messages, ("done", job.key, JobResult(job.key, "failed", message=message))]
        done = execute(job, self._place, lambda n, of: messages.append(("progress", job.key, (n, of))))
        return [*messages, ("done", job.key, done)]

    def end(self, key: str) -> None:
        """Remove a queued job; a running one cannot be stopped in-process."""
        self._jobs = deque(job for job in self._jobs if job.key != key)

    def close(self) -> None:
        """Close the segment and remove the folder in which values were saved; no job runs outside `wait`."""
        self._place.close()


@dataclass
class _Worker:
    process: subprocess.Popen[bytes]
    jobs: Connection
    lifeline: int
    batch: list[Job] = field(default_factory=list)
    """jobs without result, the running one first"""
    loaded: set[str] = field(default_factory=set)


class Pool:
    """Worker processes, started on demand and kept; one that dies fails its job alone and is replaced.

    Workers run in their own session, so that Ctrl-C reaches the scheduler only. Each holds the reading end of a pipe that
    closes with the scheduler, and so they end when the scheduler does.
    """

    own_placement, window = False, 1

    def __init__(self, spec: WorkerSpec, offsets: Mapping[str, int] = MappingProxyType({})) -> None:
        self._spec, self._offsets = spec, dict(offsets)
        self._paths = [str(spec.root), str(Path(__file__).resolve().parent.parent)]
        self._workers: list[_Worker] = []
        self._returned: list[Message] = []

    def submit(self, jobs: list[Job], gpus: tuple[str, ...] = ()) -> None:
        """Send a batch to an idle worker, preferably one that has loaded some of the inputs, or to a new one."""
        idle = [worker for worker in self._workers if not worker.batch]
        wanted = set(jobs[0].inputs.values())
        worker = max(idle, key=lambda worker: len(wanted & worker.loaded)) if idle else self._start()
        worker.batch, worker.loaded = list(jobs), set(jobs[-1].inputs.values())
        try:
            worker.jobs.send(jobs)
        except (BrokenPipeError, ConnectionResetError):
            return  # the worker died while idle; `wait` reports it

    def wait(self, timeout_s: float | None) -> list[Message]:
        """Return the messages of all workers."""
        messages, self._returned = self._returned, []
        busy = {worker.jobs: worker for worker in self._workers if worker.batch}
        for connection in wait(list(busy), 0 if messages else timeout_s):
            worker = busy[connection]  # type: ignore[index]
            try:
                message = worker.jobs.recv()
            except (EOFError, ConnectionResetError):
                messages += self._died(worker)
                continue
            messages.append(message)
            if message[0] == "done":
                worker.batch.pop(0)
        return messages

    def end(self, key: str) -> None:
        """Kill the worker that runs the job, which also releases its lease; the stage's scratch folder is kept."""
        for worker in [worker for worker in self._workers if any(job.key == key for job in worker.batch)]:
            rest = [job for job in worker.batch if job.key != key]
            self._returned += [("done", job.key, JobResult(job.key, "returned")) for job in rest]
            _kill(worker.process)
            self._drop(worker)

    def close(self) -> None:
        """End idle workers; kill busy ones, which also releases their leases."""
        for worker in self._workers:
            if worker.batch:
                _kill(worker.process)
            worker.jobs.close()
        for worker in self._workers:
            worker.process.wait()
            os.close(worker.lifeline)
        self._workers.clear()

    def _start(self) -> _Worker:
        ours, theirs = socketpair()
        read, write = os.pipe()
        code = f"import sys; sys.path[:0] = {self._paths!r}; from runner.worker import main; main(*sys.argv[1:])"
        command = [sys.executable, "-c", code, str(theirs.fileno()), str(read)]
        process = subprocess.Popen(command, pass_fds=(theirs.fileno(), read), stdin=subprocess.DEVNULL, start_new_session=True)
        theirs.close()
        os.close(read)
        worker = _Worker(process, Connection(ours.detach()), write)
        worker.jobs.send((self._spec, self._offsets))
        self._workers.append(worker)
        return worker

    def _died(self, worker: _Worker) -> list[Message]:
        status = worker.process.wait()
        _kill(worker.process)
        self._drop(worker)
        how = f"signal {signal.Signals(-status).name}" if status < 0 else f"exit status {status}"
        hint = "; the usual cause is lack of memory: raise MEMORY_GIB of the stage or lower --jobs" if status == -9 else ""
        message = f"the worker process ended with {how} before the task was done{hint}"
        first, *rest = worker.batch
        return [("done", first.key, JobResult(first.key, "died", message=message)),
                *(("done", job.key, JobResult(job.key, "returned")) for job in rest)]

    def _drop(self, worker: _Worker) -> None:
        worker.process.wait()
        worker.jobs.close()
        os.close(worker.lifeline)
        self._workers.remove(worker)


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill the worker and every process that its stage has started; they share a process group."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
