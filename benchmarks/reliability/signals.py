"""1g: Ctrl-C once, twice, three times, and SIGTERM, on the toy graph. No process is left and nothing finished is lost."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import time

from benchmarks.reliability import toy
from benchmarks.reliability.rows import Plan, Row
from tests.helpers.flipped_stores import FlippedStore

WAYS = {"SIGINT once": (signal.SIGINT,), "SIGINT twice": (signal.SIGINT,) * 2, "SIGINT three times": (signal.SIGINT,) * 3,
        "SIGTERM": (signal.SIGTERM,)}  # fmt: skip
PAUSE_S = 0.05


def rows(plan: Plan) -> list[Row]:
    """Send the signals with workers and in one process."""
    return [_row(plan, what, sent, jobs) for what, sent in WAYS.items() for jobs in (2, 0)]


def send(process: subprocess.Popen[str], signals: tuple[signal.Signals, ...]) -> None:
    """Send a signal to the whole process group, like a terminal."""
    for one in signals:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, one)
        time.sleep(PAUSE_S)


def _row(plan: Plan, what: str, sent: tuple[signal.Signals, ...], jobs: int) -> Row:
    row = Row(f"{what}, toy graph, jobs {jobs}")
    for n in range(plan.times(5, 1)):
        project = FlippedStore(plan.place(f"{what} {jobs} {n}"), toy.WIDE).write()
        process = toy.start(project, jobs)
        toy.wait_for(project, "shout")
        time.sleep(random.Random(f"{plan.seed} {what} {n}").uniform(0.0, 0.5))
        pids = toy.descendants(process.pid)
        send(process, sent)
        ended = toy.end(process, 30.0)
        wrong = [] if ended.code else [f"exit {ended.code} of a run that was stopped: {ended.stderr}"]
        row.count(wrong + toy.wrong_later(project, pids))
    return row
