"""Runs of the toy graph as processes: started, killed, ended, and compared with a clean build."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from runner.index import Index
from tests.helpers.flipped_stores import FlippedStore

SCRIPT = Path(__file__).with_name("toy_run.py")
SLEEP_S = 0.01
WIDE = tuple(chr(97 + i // 5) + chr(97 + i % 5) for i in range(25))
"""words of the wide graph: 203 tasks"""
END_S = 300.0
"""a run of the wide graph takes seconds; one that needs this long does not end"""


@dataclass(frozen=True)
class Ended:
    """A run that is over. `code` is None for one that had to be killed."""

    code: int | None
    report: dict[str, Any]
    stderr: str
    """what it wrote to stderr"""

    @property
    def executed(self) -> int:
        """Tasks that the run executed, by its own report."""
        return sum(self.report.get("ran", {}).values())


def start(project: FlippedStore, jobs: int = 2, sleep_s: float = SLEEP_S, **environment: str) -> subprocess.Popen[str]:
    """Begin a run in a session of its own."""
    command = [sys.executable, str(SCRIPT), type(project).__name__, str(project.folder), str(jobs), str(sleep_s), *project.words]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
                            env=os.environ | environment)  # fmt: skip


def end(process: subprocess.Popen[str], limit_s: float = END_S) -> Ended:
    """Wait for a run; one that does not end is killed."""
    try:
        out, message = process.communicate(timeout=limit_s)
    except subprocess.TimeoutExpired:
        kill({process.pid, *descendants(process.pid)})
        return Ended(None, {}, f"did not end within {limit_s:.0f} s")
    lines = out.strip().splitlines()
    report = json.loads(lines[-1]) if lines and lines[-1].startswith("{") else {}
    return Ended(process.returncode, report, message.strip())


def run(project: FlippedStore, jobs: int = 2, sleep_s: float = SLEEP_S, **environment: str) -> Ended:
    """A run from beginning to end."""
    return end(start(project, jobs, sleep_s, **environment))


def wrong_end(project: FlippedStore, ended: Ended, mark: str = "!") -> list[str]:
    """Return the faults of a run that should have succeeded."""
    if ended.code != 0:
        words = ended.stderr.splitlines()[-1:] + ended.report.get("failures", [])[:1]
        return [f"exit {ended.code}: {' '.join(words)}"]
    return [] if ended.report["texts"] == project.expected(mark) else ["wrong outputs"]


def descendants(pid: int) -> set[int]:
    """Processes that a process has started, and theirs."""
    children: dict[int, set[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                parent = (entry / "stat").read_text().rpartition(")")[2].split()[1]
                children.setdefault(int(parent), set()).add(int(entry.name))
    found, todo = set[int](), [pid]
    while todo:
        new = children.get(todo.pop(), set()) - found
        found |= new
        todo += new
    return found


def wait_for(project: FlippedStore, line: str, seconds: float = 60.0) -> None:
    """Wait until the log of executions contains a line with this prefix. Raises TimeoutError when none appears."""
    end_at = time.monotonic() + seconds
    while not (project.log.exists() and any(message.startswith(line) for message in project.log.read_text().splitlines())):
        if time.monotonic() > end_at:
            raise TimeoutError(f"no {line!r} in {project.log}")
        time.sleep(0.005)


def kill(pids: set[int]) -> None:
    """SIGKILL for all."""
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def left_after(pids: set[int], seconds: float = 10.0) -> set[int]:
    """Processes of `pids` that still run after a while; zombies do not."""
    end_at = time.monotonic() + seconds
    while (left := {pid for pid in pids if _runs(pid)}) and time.monotonic() < end_at:
        time.sleep(0.02)
    return left


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def finished(project: FlippedStore) -> set[str]:
    """Keys with a trace, read from the segments alone."""
    return traced(project.store)


def traced(store: Path) -> set[str]:
    """Keys with a trace in a store; none before its first run has made the folders."""
    if not (store / "traces").exists():
        return set()
    index = Index(store)
    index.load(cached=False)
    return set(index.keys())


def executions(project: FlippedStore) -> int:
    """Return the lines of the log of executions, and clear the log."""
    try:
        count = len(project.log.read_text().splitlines())
        project.log.unlink()
    except FileNotFoundError:
        return 0
    return count


def wrong_later(project: FlippedStore, pids: set[int], before: set[str] | None = None, mark: str = "!") -> list[str]:
    """Return the faults after a run that was ended from outside: remaining processes, and faults of the next run.

    `before` are the keys that were finished and must not be executed again.
    """
    left = left_after(pids)
    kill(left)
    wrong = [f"{len(left)} processes are left"] if left else []
    executions(project)
    kept = finished(project) if before is None else before
    wrong += [f"next run: {what}" for what in wrong_end(project, run(project), mark)]
    twice = executions(project) - (project.tasks - len(kept))
    return wrong + ([f"{twice} finished tasks executed again"] if twice else [])


def leftovers(store: Path) -> dict[str, int]:
    """Return scratch folders, locks and torn temporaries without an owner."""
    locks = [path for path in (store / "leases").glob("*") if path.name not in ("store.lock", "keys.lock")]
    torn = [path for path in store.rglob(".*") if path.is_file() and path.parent.name != "scratch"]
    return {"scratch folders": len(list((store / "scratch").iterdir())), "locks": len(locks), "torn temporaries": len(torn)}


def added(total: dict[str, int], more: dict[str, int]) -> dict[str, int]:
    """Sums by name."""
    return {name: total.get(name, 0) + count for name, count in more.items()}


def shown(counts: dict[str, int]) -> str:
    """Format the counts as a list in words."""
    return ", ".join(f"{count} {name}" for name, count in counts.items())


def gc(project: FlippedStore) -> None:
    """Collect garbage; for a process of its own."""
    project.runner().gc()
