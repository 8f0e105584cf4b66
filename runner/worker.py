"""Main loop of a worker process: receives jobs and sends messages until the scheduler closes its end or dies."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from functools import partial
from importlib.machinery import SOURCE_SUFFIXES, FileFinder, SourceFileLoader
from importlib.util import cache_from_source
from pathlib import Path
from types import CodeType
from typing import Any

from runner.canonical import file_digest
from runner.channel import Channel
from runner.counters import Counters
from runner.execute import LOADED, Job, Workplace, execute
from runner.files import stamp
from runner.memory import resident_mib

DELAY_S = 0.02
"""longest time that a message waits for others, so that many short jobs share one"""


def main(channel_fd: str, lifeline_fd: str, counters_fd: str) -> None:
    """Run batches of jobs until the scheduler closes the connection; the first message is the worker's spec.

    `lifeline_fd` is a pipe whose other end only the scheduler holds, so that it closes when the scheduler dies. `counters_fd` is
    the file in which the scheduler reads, after the death of this process, which job ran. Output of stages and libraries goes to
    stderr; stdout belongs to the scheduler.
    """
    os.dup2(2, 1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=die_with_parent, args=(int(lifeline_fd),), daemon=True).start()
    channel, counters = Channel(int(channel_fd)), Counters(int(counters_fd))
    spec, offsets = channel.receive()
    load_from_source(spec.root)
    place, outbox = Workplace(spec, offsets), Outbox(channel)
    while True:
        try:
            batch = channel.receive()
        except EOFError:
            place.close()
            return
        try:
            _run(batch, place, outbox, counters)
        except BrokenPipeError:  # the scheduler is gone
            place.close()
            return


def _run(batch: list[Job], place: Workplace, outbox: Outbox, counters: Counters) -> None:
    """Execute a batch. The size of this process (MiB) is sent before the last result, after which the next batch may come."""
    for job in batch:
        counters.begin()
        outbox.add(("started", job.key, None))
        result = execute(job, place, partial(_report, outbox, job.key))
        counters.finish()
        if job is batch[-1]:
            outbox.add(("size", "", resident_mib()))
        outbox.add(("done", job.key, result))
    outbox.flush()


def _report(outbox: Outbox, key: str, done: int, total: int) -> None:
    outbox.add(("progress", key, (done, total)))


class Outbox:
    """Messages to the scheduler, sent together: at once if none was sent in the last DELAY_S, otherwise by a thread."""

    def __init__(self, channel: Channel) -> None:
        self._channel, self._lock, self._wake = channel, threading.Lock(), threading.Event()
        self._messages: list[tuple[str, str, Any]] = []
        self._sent = 0.0
        threading.Thread(target=self._send_late, daemon=True).start()

    def add(self, message: tuple[str, str, Any]) -> None:
        """Send a message within DELAY_S; a report of progress replaces the one before it."""
        with self._lock:
            if self._messages and message[0] == "progress" and self._messages[-1][:2] == message[:2]:
                self._messages.pop()
            self._messages.append(message)
            if time.monotonic() - self._sent >= DELAY_S:
                self._send()
        if self._messages and not self._wake.is_set():
            self._wake.set()

    def flush(self) -> None:
        """Send all messages now."""
        with self._lock:
            self._send()

    def _send(self) -> None:
        if self._messages:
            self._channel.send(self._messages)
            self._messages = []
            self._sent = time.monotonic()

    def _send_late(self) -> None:
        while True:
            self._wake.wait()
            time.sleep(DELAY_S)
            self._wake.clear()
            try:
                self.flush()
            except BrokenPipeError:
                return  # the scheduler has ended, and waits for no message


def load_from_source(root: Path) -> None:
    """Load project modules from their current source, and record the stamp of each source file.

    Python otherwise accepts compiled code while the size and the modification time (in seconds) of the source are unchanged.
    """
    finder = FileFinder.path_hook((_Loader, SOURCE_SUFFIXES))

    def hook(path: str) -> FileFinder:
        if not Path(path).is_relative_to(root) or "site-packages" in path:
            raise ImportError("not a folder of the project")
        return finder(path)  # type: ignore[return-value]  # FileFinder.path_hook states no type

    sys.path_hooks.insert(0, hook)
    sys.path_importer_cache.clear()


class _Loader(SourceFileLoader):
    def get_code(self, fullname: str) -> CodeType | None:
        """Use compiled code only if it was written after the last change of the source."""
        path = self.get_filename(fullname)
        LOADED[path] = stamp(path), file_digest(Path(path))
        try:
            if os.stat(compiled := cache_from_source(path)).st_ctime_ns <= LOADED[path][0][3]:
                os.unlink(compiled)
        except FileNotFoundError:
            pass  # no compiled file yet
        except OSError:  # a folder that cannot be written to
            return self.source_to_code(self.get_data(path), path)
        return super().get_code(fullname)


def die_with_parent(fd: int) -> None:
    """Kill this process and everything that its stage has started when the parent process is gone.

    `fd` is the reading end of a pipe whose other end only the parent holds. Runs in a thread; the process leads its group.
    """
    while os.read(fd, 1):
        pass
    os.killpg(0, signal.SIGKILL)
