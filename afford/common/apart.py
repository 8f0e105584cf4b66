"""Work on a foreign file in a process of its own, with limits on its memory and time.

A module that does so runs itself: `run_apart` starts `python -m MODULE --one PATHS`, and `work_apart` is what that process does.
"""

from __future__ import annotations

import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from afford.common.errors import SourceError
from afford.common.unpickle import RefusedError

PROJECT = Path(__file__).resolve().parents[2]
ONE = "--one"
"""first argument of the process"""


def run_apart(module: str, paths: tuple[Path, ...], expected: str, limit_s: float, fix: str) -> str:
    """Run a module on paths, the first of which is the foreign file; what it printed. SourceError names the fault."""
    command = [sys.executable, "-m", module, ONE, *(str(path.resolve()) for path in paths)]
    try:
        done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, errors="replace", timeout=limit_s)
    except subprocess.TimeoutExpired as error:
        raise SourceError(paths[0].name, f"a file that is read in {limit_s:g} s", "a longer one", fix) from error
    if done.returncode != 0:
        got = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise SourceError(paths[0].name, expected, got, fix)
    return done.stdout


def work_apart(work: Callable[[], object], limit_bytes: int) -> int:
    """Do the work with a limit on memory, and print its result; exit code 1, with one line on stderr, for another file."""
    resource.setrlimit(resource.RLIMIT_DATA, (limit_bytes, limit_bytes))
    try:
        sys.stdout.write(f"{work()}\n")
    except RefusedError as error:
        sys.stderr.write(f"{error}, which was not run\n")
        return 1
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, MemoryError) as error:
        sys.stderr.write(f"no {error} where the description has it\n")
        return 1
    return 0


def main_apart(arguments: list[str], about: str | None, convert: Callable[[Path, Path], str],
               one: Callable[[Path, Path], int]) -> int:  # fmt: skip
    """Run the command line of such a module on two paths; exit code 1, with one line on stderr, when a file cannot be used."""
    if len(arguments) == 3 and arguments[0] == ONE:
        return one(Path(arguments[1]), Path(arguments[2]))
    if len(arguments) != 2:
        sys.stderr.write(about or "")
        return 2
    try:
        sys.stdout.write(convert(Path(arguments[0]), Path(arguments[1])) + "\n")
    except SourceError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0
