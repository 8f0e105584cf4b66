"""Kill everything with SIGKILL at random moments of a run, and count what the next run does twice.

    PYTHONPATH=. python benchmarks/runner/bench_kills.py [--kills 100] [--quick]

After each kill, the tasks that a plan reports as cached are the finished ones. The scheduler's own reports of finished tasks
must be among them, and the log of executions of the next run must contain none of them.
"""

from __future__ import annotations

import random
import sys
import time
from collections import Counter
from pathlib import Path

from benchmarks.runner import processes
from benchmarks.runner.measure import spent
from benchmarks.runner.parts import Plan, Row, measure
from benchmarks.runner.project import Project, answer

SHARDS = 200
SEED = 1


def rows(plan: Plan) -> list[Row]:
    """One row."""
    project = Project(plan.place("kills"), SHARDS, words=25).write()
    log, reported = plan.folder / "log", plan.folder / "reported"
    began = time.monotonic()
    clean = processes.run(project, log, reported).found["outputs"]
    took, chance, sums = time.monotonic() - began, random.Random(SEED), Counter[str]()
    for _ in range(plan.kills):
        sums.update(_kill(project, log, reported, chance.uniform(0.05, took), clean))
    what = f"`kill -9` of everything at {plan.kills} random moments, {project.tasks} tasks"
    bad = {name: sums[name] for name in ("lost", "redone", "manual steps", "other outputs")}
    counts = ", ".join(f"{count} {name}" for name, count in bad.items())
    counts += f"; {sums['finished']} tasks were finished before the kills"
    return [Row(what, "0 finished lost or redone, no manual step", counts,
                not any(bad.values()), {name: float(count) for name, count in sums.items()})]  # fmt: skip


def _kill(project: Project, log: Path, reported: Path, after_s: float, clean: object) -> Counter[str]:
    """One kill in an empty store, and the run after it."""
    project.forget()
    for path in (log, reported):
        path.unlink(missing_ok=True)
    process = processes.start(project, log, reported)
    time.sleep(after_s)
    processes.kill_all(process)
    log.unlink(missing_ok=True)
    finished = set(answer(spent(project.command("plan", brief=False), project.folder).out)["cached"])
    ended = processes.run(project, log, reported.with_name("reported-later"))
    again = set(processes.lines(log))
    wrong = ended.code == 0 and ended.found["outputs"] != clean
    lost = set(processes.lines(reported)) - finished
    return Counter({"finished": len(finished), "lost": len(lost), "redone": len(finished & again),
                    "manual steps": int(ended.code != 0), "other outputs": int(wrong)})  # fmt: skip


if __name__ == "__main__":
    sys.exit(measure("kills", rows, __doc__))
