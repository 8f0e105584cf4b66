"""The scheduler's side of one worker process: start, batch, messages, end."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from socket import socketpair
from typing import Any

from runner.channel import Channel
from runner.counters import Counters
from runner.execute import Job, WorkerSpec
from runner.resources import VISIBLE

LEAVE_S = 10.0
"""time for an idle worker to end before it is killed"""


@dataclass(frozen=True)
class Ended:
    """Jobs and messages that a worker leaves behind."""

    status: int
    """exit status; negative: the signal"""
    messages: list[tuple[str, str, Any]]
    running: str
    """key of the job that ran at the end; '' if there was none"""
    fresh: bool
    """True if it never began a job"""


class WorkerProcess:
    """A process that executes one batch of jobs at a time.

    It runs in a session of its own, so that Ctrl-C reaches the scheduler only and a kill reaches everything that a stage has
    started. It holds the reading end of a pipe that closes with the scheduler, and ends then. `gpus` are those that it sees for
    all its life, because CUDA is set up once in a process; empty: those of the scheduler.
    """

    def __init__(self, spec: WorkerSpec, offsets: Mapping[str, int], gpus: tuple[str, ...] = ()) -> None:
        self.gpus = gpus
        self.batch: dict[str, Job] = {}
        """jobs without result by key, in order"""
        self.function = ""
        """stage of the last batch, whose libraries are loaded"""
        self.loaded: set[str] = set()
        """inputs of the last batch"""
        self.finished, self.resident_mib, self.first_mib = 0, 0.0, 0.0
        """jobs done; memory after the last batch, and after the first one"""
        self._keys: list[str] = []
        self._before = 0
        """keys of the batch, and number of jobs begun before it"""
        self._heard = time.monotonic()
        self._left = 0.0
        self._start(spec)
        self._pidfd = os.pidfd_open(self._process.pid) if hasattr(os, "pidfd_open") else None
        self.channel.post((spec, dict(offsets)))

    def _start(self, spec: WorkerSpec) -> None:
        ours, theirs = socketpair()
        read, self._lifeline = os.pipe()
        paths = [str(spec.root), str(Path(__file__).resolve().parent.parent)]
        code = f"import sys; sys.path[:0] = {paths!r}; from runner.worker import main; main(*sys.argv[1:])"
        environment = {**os.environ, VISIBLE: ",".join(self.gpus)} if self.gpus else None
        with tempfile.TemporaryFile() as counters:
            fds = theirs.fileno(), read, counters.fileno()
            self._counters = Counters(counters.fileno())
            self._process = subprocess.Popen([sys.executable, "-c", code, *map(str, fds)], pass_fds=fds, env=environment,
                                             stdin=subprocess.DEVNULL, start_new_session=True)  # fmt: skip
        theirs.close()
        os.close(read)
        self.channel = Channel(ours.detach(), blocking=False)

    # -- batches ---------------------------------------------------------------------------------------------------

    def submit(self, jobs: list[Job]) -> None:
        """Send a batch to this worker, which is idle."""
        self.batch = {job.key: job for job in jobs}
        self._keys, self._before = [job.key for job in jobs], self._counters.read()[0]
        self.function, self.loaded = jobs[0].spec.function, set(jobs[-1].inputs.values())
        self._heard = time.monotonic()
        self.channel.post(jobs)

    def messages(self) -> list[tuple[str, str, Any]]:
        """Messages that have arrived; finished jobs leave the batch."""
        found = [message for together in self.channel.arrived() for message in together]
        self._heard = time.monotonic() if found else self._heard
        for what, key, payload in found:
            if what == "done":
                self.batch.pop(key, None)
                self.finished += 1
            elif what == "size":
                self.first_mib, self.resident_mib = self.first_mib or payload, payload
        return [message for message in found if message[0] != "size"]

    def deadline(self) -> float:
        """Time, on the clock of time.monotonic, by which a message must arrive; infinite for an idle worker."""
        if not self.batch:
            return float("inf")
        return self._heard + (next(iter(self.batch.values())).spec.timeout_s or float("inf"))

    # -- the process -----------------------------------------------------------------------------------------------

    def register(self, poll: select.poll) -> list[int]:
        """Add the descriptors on which this worker reports, and where its end shows; return them.

        The end shows on a descriptor of its own (on Linux), since processes of a stage may outlive the worker and keep its
        connection open.
        """
        poll.register(self.channel.fileno(), select.POLLIN | (select.POLLOUT if self.channel.pending else 0))
        if self._pidfd is None:
            return [self.channel.fileno()]
        poll.register(self._pidfd, select.POLLIN)
        return [self.channel.fileno(), self._pidfd]

    def has_ended(self) -> bool:
        """Return True when the process is gone, or has closed its connection."""
        return self.channel.ended or self._exits(0)

    def end(self) -> Ended:
        """End the process, and all processes that its stage has started, which share its group."""
        if self.channel.ended:
            self._exits(LEAVE_S)  # by itself, so that its exit status says why
        with suppress(ProcessLookupError, PermissionError):  # no process is left; a dead one, on macOS
            os.killpg(self._process.pid, signal.SIGKILL)  # before `wait`, which frees the number for other processes
        status = self._process.wait()
        messages, (begun, finished) = self.messages(), self._counters.read()
        at = begun - 1 - self._before
        running = self._keys[at] if begun > finished and 0 <= at < len(self._keys) else ""
        self._close()
        return Ended(status, messages, running, begun == 0)

    def leave(self) -> None:
        """Close the connection of an idle worker, which then ends."""
        self.channel.close()
        self._left = time.monotonic()

    def is_gone(self, wait: bool = False) -> bool:
        """Return True when a worker that leaves is gone; it is killed when that takes longer than LEAVE_S."""
        left_s = max(0.0, self._left + LEAVE_S - time.monotonic())
        if not self._exits(left_s if wait else 0) and left_s:
            return False
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._close()
        return True

    def _exits(self, timeout_s: float) -> bool:
        """Wait for the end of the process, without freeing its number where the system can; True when it has ended."""
        if self._pidfd is None:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(timeout_s)
            return self._process.returncode is not None
        poll = select.poll()
        poll.register(self._pidfd, select.POLLIN)
        return bool(poll.poll(1000 * timeout_s))

    def _close(self) -> None:
        if not self._left:
            self.channel.close()
        os.close(self._lifeline)
        if self._pidfd is not None:
            os.close(self._pidfd)
        self._counters.close()
