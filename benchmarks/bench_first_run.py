"""Measure what a new user waits for, and write it into the README: minutes, disk and memory of the first commands.

    PYTHONPATH=. python benchmarks/bench_first_run.py [--test]

Clones the checked-out commit into a temporary folder and runs the commands of the README there, one after the other. Needs an idle
machine and access to a package index. Memory counts shared pages as their share (PSS), so Linux only. With --test
`make test` is measured, too; otherwise its row stays as it was.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import tempfile
import threading
import time
from pathlib import Path
from typing import NamedTuple

import psutil

from benchmarks.pages import ROOT, into

SELF = Path(__file__).name
PAGE, BLOCK = ROOT / "README.md", "first run"
HEAD = "| command | result | minutes | disk | peak memory |\n|---|---|--:|--:|--:|\n"
PERIOD_S = 0.5


class Cost(NamedTuple):
    """Cost of a command."""

    minutes: float
    disk_gb: float
    """growth of the clone"""
    memory_gb: float
    """highest sum over the processes of the command, shared pages counted once"""


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--test", action="store_true", help="measure `make test` as well")
    with_tests = parser.parse_args().test
    rows = {"make setup": "the environment in `.venv`", "make dataset": "a data set and recordings of six clips"}
    rows |= {"make test": "every law, on small cases"} if with_tests else {}
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / "afford"
        subprocess.run(("git", "clone", "--quiet", ROOT, clone), check=True)
        lines = []
        for command, result in rows.items():
            lines.append(row(command, result, measure(command, clone)))
            print(lines[-1], end="", flush=True)
    kept = [] if with_tests else re.findall(r"^\| `make test`.*\n", PAGE.read_text(encoding="utf-8"), re.M)
    into(PAGE, BLOCK, SELF, f"On {os.cpu_count()} cores, the first time:\n\n{HEAD}{''.join(lines + kept)}")


def row(command: str, result: str, cost: Cost) -> str:
    """Line of the table."""
    return f"| `{command}` | {result} | {cost.minutes:.1f} | {cost.disk_gb:.1f} GB | {cost.memory_gb:.1f} GB |\n"


def measure(command: str, folder: Path) -> Cost:
    """Run a command in a folder. CalledProcessError when it fails."""
    before, began = used(folder), time.monotonic()
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    process = subprocess.Popen(command.split(), cwd=folder, env=environment)
    peak, done = [0.0], threading.Event()
    watcher = threading.Thread(target=watch, args=(process.pid, peak, done))
    watcher.start()
    code = process.wait()
    minutes = (time.monotonic() - began) / 60
    done.set()
    watcher.join()
    if code:
        raise subprocess.CalledProcessError(code, command)
    return Cost(minutes, used(folder) - before, peak[0])


def watch(pid: int, peak: list[float], done: threading.Event) -> None:
    """Raise `peak[0]` to the memory of a process and its descendants, until `done`."""
    while not done.wait(PERIOD_S):
        try:
            family = [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]
            peak[0] = max(peak[0], sum(one.memory_full_info().pss for one in family) / 1e9)
        except psutil.NoSuchProcess:  # one of them ended meanwhile
            continue


def used(folder: Path) -> float:
    """GB on disk, hard links counted once."""
    return int(subprocess.run(("du", "-sk", folder), stdout=subprocess.PIPE, check=True, text=True).stdout.split()[0]) * 1024 / 1e9


if __name__ == "__main__":
    main()
