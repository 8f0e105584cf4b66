"""Main loop of a worker process: receives jobs and sends messages until the scheduler closes its end or dies."""

from __future__ import annotations

import os
import signal
import sys
import threading
from functools import partial
from importlib.machinery import SOURCE_SUFFIXES, FileFinder, SourceFileLoader
from importlib.util import cache_from_source
from multiprocessing.connection import Connection
from pathlib import Path
from types import CodeType

from runner.canonical import file_digest
from runner.execute import LOADED, Workplace, execute
from runner.files import stamp


def main(jobs_fd: str, lifeline_fd: str) -> None:
    """Run batches of jobs until the scheduler closes the connection; the first message is the worker's spec.

    `lifeline_fd` is a pipe whose other end only the scheduler holds, so that it closes when the scheduler dies. Output of
    stages and libraries goes to stderr; stdout belongs to the scheduler.
    """
    os.dup2(2, 1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_die_with_parent, args=(int(lifeline_fd),), daemon=True).start()
    jobs = Connection(int(jobs_fd))
    spec, offsets = jobs.recv()
    load_from_source(spec.root)
    place = Workplace(spec, offsets)
    while True:
        try:
            batch = jobs.recv()
        except EOFError:
            place.close()
            return
        for job in batch:
            jobs.send(("started", job.key, None))
            jobs.send(("done", job.key, execute(job, place, partial(_report, jobs, job.key))))


def _report(jobs: Connection, key: str, done: int, total: int) -> None:
    jobs.send(("progress", key, (done, total)))


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


def _die_with_parent(fd: int) -> None:
    """Kill this process and everything that its stage has started when the scheduler is gone."""
    while os.read(fd, 1):
        pass
    os.killpg(0, signal.SIGKILL)
