"""Where jobs run, behind three calls: submit a job, wait for any message, close. Keys and paths travel, never arrays."""

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
from runner.execute import Done, Job, Place, execute
from runner.modules import outdated
from runner.store import Store

Message = tuple[str, str, Any]
"""('done', key, Done) or ('progress', key, (done, total))"""


class Engine(Protocol):
    """Somewhere to run jobs."""

    def submit(self, job: Job) -> None:
        """Begin a job, soon; the caller keeps to its budget of cores and memory."""

    def wait(self, timeout_s: float | None) -> list[Message]:
        """What happened, at least one message unless the time is over."""

    def end(self, key: str) -> None:
        """Stop a job that was submitted; nothing more is said of it."""

    def close(self) -> None:
        """End what still runs; nothing finished is lost."""


class Inline:
    """Jobs run in this process, one after the other, when they are waited for."""

    def __init__(self, place: Place) -> None:
        self._place, self._store = place, Store(place.store, resolve(place.codec))
        self._jobs: deque[Job] = deque()

    def submit(self, job: Job) -> None:
        """Keep it for `wait`."""
        self._jobs.append(job)

    def wait(self, timeout_s: float | None) -> list[Message]:
        """Run the next job."""
        if not self._jobs:
            return []
        job, messages = self._jobs.popleft(), []
        old = outdated(path for path, _ in job.sources)
        if old is not None:
            said = f"{old} was edited after this process imported it; run again in a new process, or with --jobs 1"
            return [("done", job.key, Done(job.key, "failed", message=said))]
        done = execute(job, self._place, self._store, lambda n, of: messages.append(("progress", job.key, (n, of))))
        return [*messages, ("done", job.key, done)]

    def end(self, key: str) -> None:
        """It has not begun: what has, has ended."""
        self._jobs = deque(job for job in self._jobs if job.key != key)

    def close(self) -> None:
        """Nothing runs outside `wait`: only what values were saved in is left."""
        self._store.clean()


@dataclass
class _Worker:
    process: subprocess.Popen[bytes]
    jobs: Connection
    lifeline: int
    job: Job | None = None
    loaded: set[str] = field(default_factory=set)


class Pool:
    """Worker processes, started when they are needed and kept; one that dies fails its job alone and is replaced.

    Workers run in a session of their own, so that Ctrl-C reaches the scheduler only, and end when the scheduler does, however
    it ends: each holds the reading end of a pipe that closes with it.
    """

    def __init__(self, place: Place) -> None:
        self._place = place
        self._paths = [str(place.root), str(Path(__file__).resolve().parent.parent)]
        self._workers: list[_Worker] = []

    def submit(self, job: Job) -> None:
        """Give the job to an idle worker, preferably one that has just loaded some of the inputs, or to a new one."""
        idle = [worker for worker in self._workers if worker.job is None]
        wanted = set(job.inputs.values())
        worker = max(idle, key=lambda worker: len(wanted & worker.loaded)) if idle else self._start()
        worker.job, worker.loaded = job, wanted
        try:
            worker.jobs.send(job)
        except (BrokenPipeError, ConnectionResetError):
            return  # it died while idle; `wait` will find out and say so

    def wait(self, timeout_s: float | None) -> list[Message]:
        """Messages of all workers that have any."""
        busy = {worker.jobs: worker for worker in self._workers if worker.job is not None}
        messages: list[Message] = []
        for connection in wait(list(busy), timeout_s):
            worker = busy[connection]  # type: ignore[index]
            assert worker.job is not None
            try:
                what, *said = worker.jobs.recv()
            except (EOFError, ConnectionResetError):
                messages.append(("done", worker.job.key, self._died(worker)))
                continue
            messages.append((what, worker.job.key, said[0] if what == "done" else tuple(said)))
            worker.job = None if what == "done" else worker.job
        return messages

    def end(self, key: str) -> None:
        """Kill the worker that is at it, its lease with it; what the stage has put aside stays for the next time."""
        for worker in [worker for worker in self._workers if worker.job is not None and worker.job.key == key]:
            _kill(worker.process)
            self._drop(worker)

    def close(self) -> None:
        """Idle workers leave by themselves; busy ones are killed, their leases with them."""
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
        place = [str(self._place.store), self._place.codec, self._place.worker or "", str(self._place.root), *self._place.schemas]
        code = f"import sys; sys.path[:0] = {self._paths!r}; from runner.worker import main; main(*sys.argv[1:])"
        command = [sys.executable, "-c", code, str(theirs.fileno()), str(read), *place]
        process = subprocess.Popen(command, pass_fds=(theirs.fileno(), read), stdin=subprocess.DEVNULL, start_new_session=True)
        theirs.close()
        os.close(read)
        worker = _Worker(process, Connection(ours.detach()), write)
        self._workers.append(worker)
        return worker

    def _died(self, worker: _Worker) -> Done:
        assert worker.job is not None
        status = worker.process.wait()
        _kill(worker.process)
        self._drop(worker)
        how = f"signal {signal.Signals(-status).name}" if status < 0 else f"exit status {status}"
        hint = "; the usual cause is that memory ran out: raise MEMORY_GIB of the stage or lower --jobs" if status == -9 else ""
        return Done(worker.job.key, "failed", message=f"its worker process ended with {how} before the task was done{hint}")

    def _drop(self, worker: _Worker) -> None:
        worker.process.wait()
        worker.jobs.close()
        os.close(worker.lifeline)
        self._workers.remove(worker)


def _kill(process: subprocess.Popen[bytes]) -> None:
    """The worker and whatever its stage has started: they share a process group of their own."""
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
