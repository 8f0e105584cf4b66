"""The main loop of a worker process: a job in, messages out, until the scheduler closes its end or dies."""

from __future__ import annotations

import os
import signal
import threading
from multiprocessing.connection import Connection
from pathlib import Path

from runner.codec import resolve
from runner.execute import Place, execute
from runner.store import Store


def main(jobs_fd: str, lifeline_fd: str, store: str, codec: str, worker: str) -> None:
    """`lifeline_fd` is a pipe whose other end only the scheduler holds: it closes when the scheduler is gone. What stages and their
    libraries print goes to stderr: stdout is the scheduler's."""
    os.dup2(2, 1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_die_with_parent, args=(int(lifeline_fd),), daemon=True).start()
    jobs, place = Connection(int(jobs_fd)), Place(Path(store), codec, worker or None)
    shelf = Store(place.store, resolve(place.codec))
    while True:
        try:
            job = jobs.recv()
        except EOFError:
            shelf.clean()
            return
        jobs.send(("done", execute(job, place, shelf, lambda done, total: jobs.send(("progress", done, total)))))


def _die_with_parent(fd: int) -> None:
    """Nobody waits for the task any more: this process ends, with all that its stage has started."""
    while os.read(fd, 1):
        pass
    os.killpg(0, signal.SIGKILL)
