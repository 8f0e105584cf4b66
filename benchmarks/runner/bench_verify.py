"""Measure how fast `verify` reads large files on one core.

PYTHONPATH=. python benchmarks/runner/bench_verify.py [--mib 256] [--quick]
"""

from __future__ import annotations

import sys

from benchmarks.runner.parts import Plan, Row, measure
from benchmarks.runner.project import Project

GOAL = 2.0
FILES = 2


def rows(plan: Plan) -> list[Row]:
    """Four files: two inputs and what one stage makes of them; every file is copied into the store."""
    project = Project(plan.place("verify"), FILES, 1, words=plan.mib << 18, jobs=0).write()
    project.call("run")
    idle = Project(plan.place("empty"), FILES, 1, words=1, jobs=0).write()
    idle.call("run")
    rates = []
    for _ in range(plan.rounds):
        done, found = project.call("verify")
        if not found["ok"]:
            raise RuntimeError("verify finds damage in a new store")
        rates.append(found["bytes"] / 1e9 / (done.cpu_s - idle.cpu_s("verify")))
    rate = sorted(rates)[len(rates) // 2]
    return [Row(f"verify, {found['bytes'] / 1e9:.1f} GB in files of {plan.mib} MiB", f"{GOAL:.0f} GB/s a core",
                f"{rate:.1f} GB/s a core", rate >= GOAL, {"gb_s": rate},
                "per CPU second, less the start of the process")]  # fmt: skip


if __name__ == "__main__":
    sys.exit(measure("verify", rows, __doc__))
