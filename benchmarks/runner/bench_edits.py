"""Measure what runs again after edits, and what one changed shard costs.

PYTHONPATH=. python benchmarks/runner/bench_edits.py [--shards 1000] [--quick]
"""

from __future__ import annotations

import sys

from benchmarks.runner.parts import Plan, Row, measure
from benchmarks.runner.project import Project, ran

GOAL_S = 0.2


def rows(plan: Plan) -> list[Row]:
    """One changed shard, then each kind of edit."""
    project = Project(plan.place("edits"), plan.shards).write()
    project.call("run")
    many = f"0/{plan.shards}/0"
    return [_one(plan, project),
            _counted("a constant of b changed, same output", project.now(factor=259), many),
            _counted("undone", project, "0/0/0"),
            _counted("comments in b and in its helper", project.now(comment="# a comment\n"), "0/0/0"),
            _counted("b and its helper moved to another folder", project.now(moved=True), "0/0/0"),
            _counted("moved back", project, "0/0/0")]  # fmt: skip


def _one(plan: Plan, project: Project) -> Row:
    """One other shard in each round: its run is never cached."""
    costs, counts = [], set()
    for n in range(plan.rounds):
        done, found = project.now(changed=(n + 1) << 20).call("run")
        costs.append(done.cpu_s)
        counts.add(ran(found))
    cpu = sorted(costs)[len(costs) // 2]
    return Row(f"1 of {plan.shards:,} shards changed", f"{GOAL_S} s, 1/1/1", f"{cpu:.3f} s, {' '.join(sorted(counts))}",
               cpu <= GOAL_S and counts == {"1/1/1"}, {"cpu_s": cpu})  # fmt: skip


def _counted(what: str, project: Project, expected: str) -> Row:
    done, found = project.write().call("run")
    measured = f"{ran(found)}, {done.cpu_s:.2f} s"
    return Row(f"{what} (executed a/b/c)", expected, measured, ran(found) == expected, {"cpu_s": done.cpu_s})


if __name__ == "__main__":
    sys.exit(measure("edits", rows, __doc__))
