"""Measure `run dataset` with nothing to do, from the command line, on a finished store.

PYTHONPATH=. python benchmarks/runner/bench_command.py --store DIR [--source DIR]
"""

from __future__ import annotations

import json
import sys

from benchmarks.pages import ROOT
from benchmarks.runner.measure import in_turns, spent
from benchmarks.runner.parts import Plan, Row, measure

GOAL_S = 0.5


def rows(plan: Plan) -> list[Row]:
    """One row; without a store it says so."""
    what, goal = "`run dataset`, nothing to do", f"{GOAL_S} s"
    if not plan.store:
        return [Row(what, goal, "not measured: needs --store of a finished store")]
    command = [sys.executable, str(ROOT / "pipeline.py"), "run", "dataset", "--json", "--store", plan.store,
               *(["--source", plan.source] if plan.source else [])]  # fmt: skip
    spent(command, ROOT)  # finishes what is missing, and fills caches
    found = json.loads(spent(command, ROOT).out.strip().splitlines()[-1])
    executed, tasks = sum(found["ran"].values()), sum(found["cached"].values())
    cpu = in_turns({"run": lambda: spent(command, ROOT).cpu_s}, plan.rounds)["run"]
    measured = f"{cpu:.2f} s, {executed} executed"
    return [Row(f"{what} ({tasks} tasks)", goal, measured, cpu <= GOAL_S and not executed, {"cpu_s": cpu})]


if __name__ == "__main__":
    sys.exit(measure("command", rows, __doc__))
