"""Runs that are started, killed with all their processes, or left to end, and what they did."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.reliability.toy import descendants, left_after
from benchmarks.runner.measure import usual
from benchmarks.runner.project import Project, answer

LIMIT_S = 300.0


@dataclass(frozen=True)
class Ended:
    """A run that is over."""

    code: int
    found: dict[str, Any]
    messages: str


def start(project: Project, log: Path, reported: Path, **environment: str) -> subprocess.Popen[str]:
    """Begin a run; `log` gets a line when a stage starts, `reported` one when the scheduler knows of its end."""
    command = project.command("run", str(reported), brief=False)
    return subprocess.Popen(command, cwd=project.folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                            stderr=subprocess.PIPE, text=True, env=usual() | {"BENCH_LOG": str(log)} | environment)  # fmt: skip


def end(process: subprocess.Popen[str]) -> Ended:
    """Wait for a run."""
    out, messages = process.communicate(timeout=LIMIT_S)
    return Ended(process.returncode, answer(out) if process.returncode == 0 else {}, messages.strip()[-300:])


def run(project: Project, log: Path, reported: Path) -> Ended:
    """A run from beginning to end."""
    return end(start(project, log, reported))


def kill_all(process: subprocess.Popen[str]) -> None:
    """SIGKILL for a scheduler and every process below it, and wait until all are gone. The scheduler is stopped first."""
    with contextlib.suppress(ProcessLookupError):
        os.kill(process.pid, signal.SIGSTOP)
    pids = descendants(process.pid)
    for pid in (process.pid, *pids):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    process.communicate()
    if left := left_after(pids):
        raise RuntimeError(f"{len(left)} processes survived kill -9")


def lines(path: Path) -> list[str]:
    """Whole lines of a log; none where it was not written."""
    return path.read_text().split("\n")[:-1] if path.exists() else []
