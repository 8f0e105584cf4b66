"""Measure the cost of a cold task, its output hashed and put in place atomically, for graphs of several sizes.

PYTHONPATH=. python benchmarks/runner/bench_cold.py [--cold 99,999,9999] [--quick]
"""

from __future__ import annotations

import sys
from functools import partial

from benchmarks.runner.measure import in_turns
from benchmarks.runner.parts import Plan, Row, measure
from benchmarks.runner.project import Project

GOAL_MS, GROWTH = 0.8, 1.2
ROUNDS = 3


def rows(plan: Plan) -> list[Row]:
    """One row for each size, and the growth from the smallest to the largest."""
    measures = {tasks: Project(plan.place(f"cold-{tasks}"), tasks // 3).write() for tasks in plan.cold}
    found = in_turns({str(tasks): partial(_cold, project) for tasks, project in measures.items()}, min(plan.rounds, ROUNDS))
    ms = {tasks: 1000 * found[str(tasks)] / tasks for tasks in plan.cold}
    first, last = plan.cold[0], plan.cold[-1]
    growth = ms[last] / ms[first]
    made = [_row(tasks, ms[tasks], tasks == last) for tasks in plan.cold]
    return [*made, Row(f"cold, a task of {last:,} against a task of {first:,}", f"within {GROWTH} x", f"{growth:.2f} x",
                       growth <= GROWTH, {"growth": growth})]  # fmt: skip


def _row(tasks: int, ms: float, judged: bool) -> Row:
    goal = f"{GOAL_MS} ms (aim 0.6)" if judged else ""
    return Row(f"cold, {tasks:,} tasks of 10 kB in two workers, a task", goal, f"{ms:.2f} ms", ms <= GOAL_MS if judged else None,
               {"ms": ms}, "the start of three processes included")  # fmt: skip


def _cold(project: Project) -> float:
    """CPU seconds of a run in a new store; the former one is only moved away, because ext4 creates files slowly after deletions."""
    former = project.folder / project.store
    if former.exists():
        former.rename(project.folder / f"former-{len(list(project.folder.glob('former-*')))}")
    return project.cpu_s("run")


if __name__ == "__main__":
    sys.exit(measure("cold", rows, __doc__))
