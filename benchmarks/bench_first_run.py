"""Measure what a new user waits for, and write it into the README: minutes, disk and memory of the first commands.

    PYTHONPATH=. python benchmarks/bench_first_run.py [--test] [--meshes DIR]

Clones the checked-out commit into a temporary folder and runs the commands of the README there, one after the other. Needs an idle
machine and access to a package index. Memory counts shared pages as their share (PSS), so Linux only. With --test
`make test` is measured, too, and with --meshes the negative affordances of a folder of meshes; otherwise their rows stay.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
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
    parser.add_argument("--meshes", type=Path, help="folder of meshes for `make negative-affordance SOURCE=`")
    args = parser.parse_args()
    rows = {"make setup": "the environment in `.venv`",
            'predict photo.jpg "pour tea"': "regions of both hands, by the shipped model",
            "make negative-affordance SOURCE=meshes": "where a hand must not go on your meshes, by the shipped scorer",
            "make dataset": "a data set and recordings of six clips", "make test": "every law, on small cases"}  # fmt: skip
    measured = [name for name in rows if (args.test or name != "make test") and (args.meshes or "SOURCE" not in name)]
    page = PAGE.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        clone = Path(folder) / "afford"
        subprocess.run(("git", "clone", "--quiet", ROOT, clone), check=True)
        lines = []
        for name, result in rows.items():
            if name in measured:
                lines.append(row(name, result, measure(typed(name, clone, args.meshes), clone)))
                print(lines[-1], end="", flush=True)
            else:
                lines += re.findall(rf"^\| `{re.escape(name)}`.*\n", page, re.M)
    into(PAGE, BLOCK, SELF, f"On {os.cpu_count()} cores, the first time:\n\n{HEAD}{''.join(lines)}")


def typed(name: str, clone: Path, meshes: Path | None) -> str:
    """Command of a row: a picture out of the clone for `photo.jpg`, the folder of the user's meshes for `meshes`."""
    if name.startswith("predict"):
        photo = next((clone / "weights" / "twohands" / "examples").glob("*.jpg")).relative_to(clone)
        return f".venv/bin/python pipeline.py {name.replace('photo.jpg', str(photo))} --out found"
    return name.replace("meshes", str(meshes.absolute())) if meshes else name


def row(command: str, result: str, cost: Cost) -> str:
    """Line of the table."""
    return f"| `{command}` | {result} | {cost.minutes:.1f} | {cost.disk_gb:.1f} GB | {cost.memory_gb:.1f} GB |\n"


def measure(command: str, folder: Path) -> Cost:
    """Run a command in a folder. CalledProcessError when it fails."""
    before, began = used(folder), time.monotonic()
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    process = subprocess.Popen(shlex.split(command), cwd=folder, env=environment)
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
