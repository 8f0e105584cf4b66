"""Small files that state, or unpack to, something very large. A reader refuses them before it allocates, in bounded time."""

from __future__ import annotations

import multiprocessing
import resource
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

GROWTH_MIB = 512
"""how much a reader may allocate before it refuses a bomb"""
CPU_S = 20
"""a reader that is quadratic in what a file states does not get through its bomb in this time; a linear one needs none of it"""


@dataclass(frozen=True)
class Bomb:
    """A file of this kind, the reader it is meant for, and the errors that refuse it (empty: it is read, in bounds)."""

    name: str
    write: Callable[[Path], Path]
    read: Callable[[Path], object]
    errors: tuple[type[Exception], ...]


def defuse(bomb: Bomb, folder: Path) -> str:
    """Read a bomb in a process of its own. Returns '' when all is well, else what went wrong."""
    folder.mkdir(parents=True, exist_ok=True)
    path = bomb.write(folder)
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe()
    process = context.Process(target=_read, args=(bomb, path, theirs))
    process.start()
    theirs.close()
    try:
        said = str(ours.recv())
    except EOFError:
        said = "its process died: CPU time or memory ran out"
    process.join()
    return said


def _read(bomb: Bomb, path: Path, answer) -> None:  # type: ignore[no-untyped-def]
    spent = resource.getrusage(resource.RUSAGE_SELF)
    limit = int(spent.ru_utime + spent.ru_stime) + CPU_S
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
    before = _peak_mib()
    try:
        bomb.read(path)
        said = "" if not bomb.errors else "it was accepted"
    except bomb.errors as error:
        said = "" if str(error) and "\n" not in str(error) else f"no sentence: {error!r}"
    except BaseException as error:
        said = f"{type(error).__name__}: {error}"
    grown = _peak_mib() - before
    answer.send(said or (f"it allocated {grown:.0f} MiB" if grown > GROWTH_MIB else ""))


def _peak_mib() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
