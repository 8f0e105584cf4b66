"""CPU seconds of process trees, in interleaved rounds."""

from __future__ import annotations

import os
import statistics
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Spent:
    """Use and output of a process tree."""

    cpu_s: float
    """user and system seconds of the process and of every process below it that was waited for"""
    out: str


def spent(command: list[str], folder: Path, **environment: str) -> Spent:
    """Run a command and measure it; RuntimeError with the end of its messages when it fails."""
    with tempfile.TemporaryFile("w+") as messages:
        process = subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=messages,
                                   text=True, env=usual() | environment)  # fmt: skip
        assert process.stdout is not None
        out = process.stdout.read()
        process.stdout.close()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            messages.seek(0)
            raise RuntimeError(f"{' '.join(command)[:200]} ended with {process.returncode}: {messages.read()[-600:]}{out[-300:]}")
    return Spent(usage.ru_utime + usage.ru_stime, out)


def usual() -> dict[str, str]:
    """Environment of a user's run: Python keeps compiled modules."""
    return {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}


def in_turns(measures: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """Medians of several measures that take turns, so that all meet the same load."""
    found: dict[str, list[float]] = {name: [] for name in measures}
    for _ in range(rounds):
        for name, measure in measures.items():
            found[name].append(measure())
    return {name: statistics.median(values) for name, values in found.items()}
