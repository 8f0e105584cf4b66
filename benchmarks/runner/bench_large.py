"""Measure a graph of 100,000 tasks of one small blob each: cold, with nothing to do, and what the commands that look at it cost.

PYTHONPATH=. python benchmarks/runner/bench_large.py [--large 100000] [--quick]
"""

from __future__ import annotations

import sys

from benchmarks.runner.parts import Plan, Row, measure
from benchmarks.runner.project import Project
from runner import Runner

STAGES = 10
COLD_S, COLD_MIB, IDLE_S, IDLE_MIB, LOOK_S = 120.0, 600.0, 2.5, 400.0, 3.0
"""goals for 100,000 tasks"""
VERBS = {"plan": "`status`", "explain": "`explain`", "stale": "`stale`"}


def rows(plan: Plan) -> list[Row]:
    """Cold, then nothing to do, then the commands."""
    project = Project(plan.place("large"), plan.large // STAGES, STAGES, words=4).write()
    share, size = plan.large / 100_000, f"{plan.large:,} tasks of one small blob ({STAGES} stages)"
    cold, found = project.call("run")
    peak = found["peak_mib"]
    goal = f"{COLD_S:.0f} s CPU, scheduler's peak {COLD_MIB:.0f} MB"
    made = [Row(f"cold, {size}, two workers", goal, f"{cold.cpu_s:.1f} s, {peak:.0f} MiB",
                cold.cpu_s <= COLD_S * share and peak <= COLD_MIB, {"cpu_s": cold.cpu_s, "mib": peak})]  # fmt: skip
    idle = sorted((done.cpu_s, found["peak_mib"]) for done, found in (project.call("run") for _ in range(plan.rounds)))
    cpu, peak = idle[len(idle) // 2]
    made.append(Row(f"nothing to do, {size}", f"{IDLE_S} s CPU, {IDLE_MIB:.0f} MB", f"{cpu:.2f} s, {peak:.0f} MiB",
                    cpu <= IDLE_S and peak <= IDLE_MIB, {"cpu_s": cpu, "mib": peak}))
    return made + [_look(plan, project, verb, size) for verb in VERBS]


def _look(plan: Plan, project: Project, verb: str, size: str) -> Row:
    """Median cost of a verb; on a Runner that lacks it, a row that says so."""
    what, goal = f"{VERBS[verb]}, {size}", f"{LOOK_S:.0f} s CPU"
    if not hasattr(Runner, verb):
        return Row(what, goal, f"Runner has no {verb} here")
    cpu = sorted(project.cpu_s(verb) for _ in range(plan.rounds))[plan.rounds // 2]
    return Row(what, goal, f"{cpu:.2f} s", cpu <= LOOK_S, {"cpu_s": cpu})


if __name__ == "__main__":
    sys.exit(measure("large", rows, __doc__))
