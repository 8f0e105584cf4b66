"""1b: five runs at once on one store. All succeed, every task is done once, all have the same outputs."""

from __future__ import annotations

from benchmarks.reliability import toy
from benchmarks.reliability.rows import Plan, Row
from tests.helpers.flipped_stores import FlippedStore, apart

AT_ONCE = 5


def rows(plan: Plan) -> list[Row]:
    """Rounds of five."""
    row, executed, tasks, digests = Row(f"{AT_ONCE} runs at once on one store"), 0, 0, set[str]()
    for n in range(plan.times(6, 1)):
        project = FlippedStore(plan.place(f"at-once-{n}"), toy.WIDE).write()
        processes = [toy.start(project) for _ in range(AT_ONCE)]
        ended = [toy.end(process) for process in processes]
        lines = toy.executions(project)
        executed, tasks = executed + lines, tasks + project.tasks
        digests |= {str(one.report.get("outputs")) for one in ended}
        wrong = [toy.wrong_end(project, one) for one in ended]
        if lines != project.tasks or sum(one.executed for one in ended) != project.tasks:
            wrong[-1].append(f"{lines} executions of {project.tasks} tasks")
        wrong[-1] += [] if apart(project.verify) else ["verify is not ok"]
        for one in wrong:
            row.count(one)
    row.figures = f"{tasks} tasks, {executed - tasks} executed twice, {len(digests)} set of outputs"
    return [row]
