"""1a: kill -9 at random moments. What was finished is never made again, and the end is that of a clean build."""

from __future__ import annotations

import os
import random
import signal
import time

from benchmarks.reliability import toy
from benchmarks.reliability.rows import Plan, Row
from tests.helpers.flipped_stores import FlippedStore, NoEndError, apart, last_line

A_STORE = 2
"""kills of each store"""


def rows(plan: Plan) -> list[Row]:
    """Scheduler with all workers, and scheduler alone."""
    clean = FlippedStore(plan.place("clean"), toy.WIDE).write()
    began = time.monotonic()
    outputs = toy.run(clean).report["outputs"]
    took = time.monotonic() - began
    what = f"at random moments, graph of {clean.tasks} tasks"
    both = _killed(plan, Row(f"kill -9 of scheduler and all workers {what}"), plan.times(60, 6), took, outputs, True)
    return [both, _killed(plan, Row(f"kill -9 of the scheduler alone {what}"), plan.times(40, 4), took, outputs, False)]


def _killed(plan: Plan, row: Row, kills: int, took: float, outputs: object, workers: bool) -> Row:
    rng, left = random.Random(f"{plan.seed} {row.what}"), dict[str, int]()
    finished = again = 0
    for n in range(0, kills, A_STORE):
        project = FlippedStore(plan.place(f"{workers}-{n}"), toy.WIDE).write()
        wrong: list[list[str]] = [_kill(project, rng.uniform(0.1, took), workers) for _ in range(A_STORE)]
        before = toy.finished(project)
        toy.executions(project)
        left = toy.added(left, toy.leftovers(project.store)) if left else toy.leftovers(project.store)
        ended = toy.run(project)
        twice = toy.executions(project) - (project.tasks - len(before))
        finished, again = finished + len(before), again + twice
        wrong[-1] += _wrong(project, ended, outputs, before, twice)
        for one in wrong:
            row.count(one)
    row.figures = (f"{finished} finished tasks, {again} executed again; left behind before gc: {toy.shown(left)}")
    return row


def _kill(project: FlippedStore, after_s: float, workers: bool) -> list[str]:
    process = toy.start(project)
    time.sleep(after_s)
    pids = toy.descendants(process.pid)
    if workers:
        toy.kill({process.pid, *pids})
    else:
        os.kill(process.pid, signal.SIGKILL)
    process.communicate()
    left = toy.left_after(pids)
    toy.kill(left)
    return [f"{len(left)} processes went on after the kill"] if left else []


def _wrong(project: FlippedStore, ended: toy.Ended, outputs: object, before: set[str], twice: int) -> list[str]:
    wrong = toy.wrong_end(project, ended)
    if not wrong and ended.report["outputs"] != outputs:
        wrong.append("other digests than a clean build")
    if twice:
        wrong.append(f"{twice} finished tasks executed again")
    if before - toy.finished(project):
        wrong.append(f"{len(before - toy.finished(project))} traces lost")
    try:
        wrong += [] if apart(project.verify) else ["verify after the run is not ok"]
        apart(toy.gc, project)
    except (NoEndError, RuntimeError) as error:
        wrong.append(last_line(error))
    left = toy.leftovers(project.store)
    return wrong + ([f"after gc: {toy.shown(left)}"] if any(left.values()) else [])
