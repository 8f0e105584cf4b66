"""The main loop of a worker process: a job in, messages out, until the scheduler closes its end or dies."""

from __future__ import annotations

import os
import signal
import sys
import threading
from importlib.machinery import SOURCE_SUFFIXES, FileFinder, SourceFileLoader
from importlib.util import cache_from_source
from multiprocessing.connection import Connection
from pathlib import Path
from types import CodeType

from runner.codec import resolve
from runner.execute import LOADED, Place, execute
from runner.files import stamp
from runner.store import Store


def main(jobs_fd: str, lifeline_fd: str, store: str, codec: str, worker: str, root: str, *schemas: str) -> None:
    """`lifeline_fd` is a pipe whose other end only the scheduler holds: it closes when the scheduler is gone. What stages and their
    libraries print goes to stderr: stdout is the scheduler's.
    """
    os.dup2(2, 1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_die_with_parent, args=(int(lifeline_fd),), daemon=True).start()
    load_from_source(Path(root))
    jobs, place = Connection(int(jobs_fd)), Place(Path(store), codec, worker or None, Path(root), schemas)
    shelf = Store(place.store, resolve(place.codec))
    while True:
        try:
            job = jobs.recv()
        except EOFError:
            shelf.clean()
            return
        jobs.send(("done", execute(job, place, shelf, lambda done, total: jobs.send(("progress", done, total)))))


def load_from_source(root: Path) -> None:
    """Load modules of the project from what their files say now, and note which that was. (Python takes compiled code for current
    while a source's size and modification time, in seconds, are as they were.)
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
        """Take compiled code only when it was written after the source changed last."""
        path = self.get_filename(fullname)
        LOADED[path] = stamp(path)
        try:
            if os.stat(compiled := cache_from_source(path)).st_ctime_ns <= LOADED[path][3]:
                os.unlink(compiled)
        except FileNotFoundError:
            pass  # not compiled yet
        except OSError:  # a folder that cannot be written to
            return self.source_to_code(self.get_data(path), path)
        return super().get_code(fullname)


def _die_with_parent(fd: int) -> None:
    """Nobody waits for the task any more: this process ends, with all that its stage has started."""
    while os.read(fd, 1):
        pass
    os.killpg(0, signal.SIGKILL)
