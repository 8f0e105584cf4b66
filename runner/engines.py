"""Engines that execute jobs: submit a job, wait for messages, close. Keys and paths travel, never arrays."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from socket import socketpair
from typing import Any, Protocol

from runner.codec import resolve
from runner.execute import Job, JobResult, WorkerSpec, execute
from runner.modules import outdated
from runner.store import Store

Message = tuple[str, str, Any]
"""('done', key, Done) or ('progress', key, (done, total))"""


class Engine(Protocol):
    """Executes jobs."""

    def submit(self, job: Job) -> None:
        """Start a job soon; the caller observes the budget of cores and memory."""

    def wait(self, timeout_s: float | None) -> list[Message]:
        """Return new messages, at least one unless the time is over."""

    def end(self, key: str) -> None:
        """Stop a submitted job; no further message reports it."""

    def close(self) -> None:
        """Stop running jobs; finished results are kept."""


class Inline:
    """Executes jobs in this process, one after the other, during `wait`."""

    def __init__(self, spec: WorkerSpec) -> None:
        self._spec, self._store = spec, Store(spec.store, resolve(spec.codec))
        self._jobs: deque[Job] = deque()

    def submit(self, job: Job) -> None:
        """Queue the job for `wait`."""
        self._jobs.append(job)

    def wait(self, timeout_s: float | None) -> list[Message]:
        """Execute the next job."""
        if not self._jobs:
            return []
        job, messages = self._jobs.popleft(), []
        old = outdated(path for path, _ in job.sources)
        if old is not None:
            message = f"{old} was edited after this process imported it; run again in a new process, or with --jobs 1"
            return [("done", job.key, JobResult(job.key, "failed", message=message))]
        done = execute(job, self._spec, self._store, lambda n, of: messages.append(("progress", job.key, (n, of))))
        return [*messages, ("done", job.key, done)]

    def end(self, key: str) -> None:
        """Remove a queued job; a running one cannot be stopped in-process."""
        self._jobs = deque(job for job in self._jobs if job.key != key)

    def close(self) -> None:
        """Remove the folder in which values were saved; no job runs outside `wait`."""
        self._store.clean()


@dataclass
class _Worker:
    process: subprocess.Popen[bytes]
    jobs: Connection
    lifeline: int
    job: Job | None = None
    loaded: set[str] = field(default_factory=set)


class Pool:
    """Worker processes, started on demand and kept; one that dies fails its job alone and is replaced.

    Workers run in their own session, so that Ctrl-C reaches the scheduler only. Each holds the reading end of a pipe that
    closes with the scheduler, and so they end when the scheduler does.
    """

    def __init__(self, spec: WorkerSpec) -> None:
        self._spec = spec
        self._paths = [str(spec.root), str(Path(__file__).resolve().parent.parent)]
        self._workers: list[_Worker] = []

    def submit(self, job: Job) -> None:
        """Send the job to an idle worker, preferably one that has loaded some of the inputs, or to a new one."""
        idle = [worker for worker in self._workers if worker.job is None]
        wanted = set(job.inputs.values())
        worker = max(idle, key=lambda worker: len(wanted & worker.loaded)) if idle else self._start()
        worker.job, worker.loaded = job, wanted
        try:
            worker.jobs.send(job)
        except (BrokenPipeError, ConnectionResetError):
            return  # the worker died while idle; `wait` reports it

    def wait(self, timeout_s: float | None) -> list[Message]:
        """Return the messages of all workers."""
        busy = {worker.jobs: worker for worker in self._workers if worker.job is not None}
        messages: list[Message] = []
        for connection in wait(list(busy), timeout_s):
            worker = busy[connection]  # type: ignore[index]
            assert worker.job is not None
            try:
                what, *payload = worker.jobs.recv()
            except (EOFError, ConnectionResetError):
                messages.append(("done", worker.job.key, self._died(worker)))
                continue
            messages.append((what, worker.job.key, payload[0] if what == "done" else tuple(payload)))
            worker.job = None if what == "done" else worker.job
        return messages

    def end(self, key: str) -> None:
        """Kill the worker that runs the job, which also releases its lease; the stage's scratch folder is kept."""
        for worker in [worker for worker in self._workers if worker.job is not None and worker.job.key == key]:
            _kill(worker.process)
            self._drop(worker)

    def close(self) -> None:
        """End idle workers; kill busy ones, which also releases their leases."""
        for worker in self._workers:
            if worker.job is not None:
                _kill(worker.process)
            worker.jobs.close()
        for worker in self._workers:
            worker.process.wait()
            os.close(worker.lifeline)
        self._workers.clear()

    def _start(self) -> _Worker:
        ours, theirs = socketpair()
        read, write = os.pipe()
        arguments = [str(self._spec.store), self._spec.codec, self._spec.worker or "", str(self._spec.root), *self._spec.schemas]
        code = f"import sys; sys.path[:0] = {self._paths!r}; from runner.worker import main; main(*sys.argv[1:])"
        command = [sys.executable, "-c", code, str(theirs.fileno()), str(read), *arguments]
        process = subprocess.Popen(command, pass_fds=(theirs.fileno(), read), stdin=subprocess.DEVNULL, start_new_session=True)
        theirs.close()
        os.close(read)
        worker = _Worker(process, Connection(ours.detach()), write)
        self._workers.append(worker)
        return worker

    def _died(self, worker: _Worker) -> JobResult:
        assert worker.job is not None
        status = worker.process.wait()
        _kill(worker.process)
        self._drop(worker)
        how = f"signal {signal.Signals(-status).name}" if status < 0 else f"exit status {status}"
        hint = "; the usual cause is lack of memory: raise MEMORY_GIB of the stage or lower --jobs" if status == -9 else ""
        return JobResult(worker.job.key, "failed", message=f"the worker process ended with {how} before the task was done{hint}")

    def _drop(self, worker: _Worker) -> None:
        worker.process.wait()
        worker.jobs.close()
        os.close(worker.lifeline)
        self._workers.remove(worker)


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill the worker and every process that its stage has started; they share a process group."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
