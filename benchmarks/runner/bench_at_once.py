"""Run one graph several times at once: in one store, and on two "hosts" that share a remote alone.

PYTHONPATH=. python benchmarks/runner/bench_at_once.py [--quick]
"""

from __future__ import annotations

import inspect
import sys
from collections import Counter
from pathlib import Path

from benchmarks.runner import processes
from benchmarks.runner.parts import Plan, Row, measure
from benchmarks.runner.project import Project
from runner import Runner

SHARDS, AT_ONCE, HOSTS = 200, 5, 2
GOAL = "all exit 0, every task once"


def rows(plan: Plan) -> list[Row]:
    """Five runs in one store, two stores with one remote."""
    shards = 10 if plan.quick else SHARDS
    project = Project(plan.place("at-once"), shards, words=25).write()
    made = [_row(f"{AT_ONCE} runs at once, one store", [project] * AT_ONCE, plan)]
    what = f'{HOSTS} "hosts" at once: own temporary folder, own store, one remote'
    if "remote" not in inspect.signature(Runner).parameters:
        return [*made, Row(what, GOAL, "Runner has no remote here")]
    remote = plan.place("remote")
    hosts = [Project(plan.place(f"host-{n}"), shards, words=25, remote=str(remote)).write() for n in range(HOSTS)]
    return [*made, _row(what, hosts, plan)]


def _row(what: str, projects: list[Project], plan: Plan) -> Row:
    """Start all, and count what they executed."""
    log = plan.folder / f"log-{len(projects)}"
    started = [processes.start(project, log, plan.folder / f"reported-{n}", TMPDIR=str(_own(project, n)))
               for n, project in enumerate(projects)]  # fmt: skip
    ended = [processes.end(process) for process in started]
    executed = Counter(processes.lines(log))
    tasks, twice = projects[0].tasks, sum(executed.values()) - len(executed)
    codes, outputs = {one.code for one in ended}, {str(one.found.get("outputs")) for one in ended}
    good = codes == {0} and len(executed) == tasks and not twice and len(outputs) == 1
    messages = "; ".join(sorted({one.messages for one in ended if one.code}))
    measured = f"exit {', '.join(map(str, sorted(codes)))}; {len(executed)} executed, {twice} of them again"
    return Row(f"{what}, {tasks} tasks", GOAL, measured, good, {"executed": len(executed), "twice": twice}, messages)


def _own(project: Project, n: int) -> Path:
    """Temporary folder of one run."""
    folder = project.folder / f"tmp-{n}"
    folder.mkdir()
    return folder


if __name__ == "__main__":
    sys.exit(measure("at_once", rows, __doc__))
