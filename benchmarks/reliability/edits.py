"""1i and 2: code that is edited before, during and between runs."""

from __future__ import annotations

import os
import sys
from collections import Counter
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from benchmarks.reliability import toy
from benchmarks.reliability.rows import Plan, Row, skipped
from tests.helpers.flipped_stores import FlippedStore, NoEndError, apart, last_line

TABLE = "tests.helpers.edited_code"
"""kinds of edit, and what becomes of each"""
MARKS = ("??", "!")
"""an edit, and the edit undone; of different sizes, since Python's own cache of compiled modules knows sizes and whole seconds"""
WATCHED = ("open", "os.listdir", "os.rename", "os.mkdir", "subprocess.Popen", "fcntl.flock", "import", "os.scandir")
"""events of the interpreter at which an edit may fall"""


def rows(plan: Plan) -> list[Row]:
    """The table of edits; edits during a run; an edit between two reads of one file; an edit undone while a run is open."""
    seconds = [_same_second(plan, jobs) for jobs in (1, 0)]
    return [_table(plan), _comment(plan), _real_edit(plan), _between(plan), *seconds, _undone(plan)]


def _table(plan: Plan) -> Row:
    row = Row("kinds of edit of helpers, effect measured by running: followed, or refused aloud; none is silent")
    if find_spec(TABLE) is None:
        return skipped(row.what, f"{TABLE} is not there")
    table = import_module(TABLE)
    verdicts = table.judge(plan.place("table"))
    for verdict in verdicts:
        wanted = "refused" if verdict.case.want == table.REFUSED else "right"
        wrong = [] if verdict.outcome == wanted else [f"{verdict.case.name}: {verdict.outcome}, expected {wanted}"]
        row.count(wrong + ([] if verdict.control else [f"{verdict.case.name}: the control stage changed"]))
    row.figures = ", ".join(f"{count} {outcome}" for outcome, count in Counter(one.outcome for one in verdicts).items())
    return row


def _during(plan: Plan, name: str) -> tuple[FlippedStore, Any]:
    """A run that has begun `shout`."""
    project = FlippedStore(plan.place(name), toy.WIDE).write()
    process = toy.start(project)
    toy.wait_for(project, "shout")
    return project, process


def _comment(plan: Plan) -> Row:
    row = Row("a comment added to a helper during a run: nothing is dropped, nothing runs again")
    for n in range(plan.times(5, 1)):
        project, process = _during(plan, f"comment-{n}")
        path = project.code / "toy" / "helper.py"
        path.write_text(path.read_text() + "# one more\n")
        wrong = toy.wrong_end(project, toy.end(process))
        toy.executions(project)
        wrong += [f"next run: {what}" for what in toy.wrong_end(project, toy.run(project))]
        again = toy.executions(project)
        row.count(wrong + ([f"{again} tasks ran again"] if again else []))
    return row


def _real_edit(plan: Plan) -> Row:
    row = Row("a constant of a helper edited during a run: the next runs, with it and with the edit undone, are right")
    for n in range(plan.times(5, 1)):
        project, process = _during(plan, f"edit-{n}")
        project.edit(MARKS[0])
        ended = toy.end(process)
        wrong = [] if ended.code in (0, 1) else [f"exit {ended.code}: {ended.stderr[-200:]}"]
        for mark in MARKS:
            project.edit(mark)
            wrong += [f"{mark}: {what}" for what in toy.wrong_end(project, toy.run(project), mark)]
        row.count(wrong)
    return row


def _between(plan: Plan) -> Row:
    """The n-th event after a helper was read for its fingerprint: before it is stamped, before it is imported, later."""
    row = Row("a constant of a helper edited between the read for its fingerprint and its use: no result under a wrong key")
    for n in range(1, plan.times(60, 12) + 1):
        project = FlippedStore(plan.place(f"between-{n}"), ("ab",)).write()
        try:
            apart(_edited_run, project, n)
            wrong = []
            for mark in MARKS:
                project.edit(mark)
                found = apart(project.run, 1)
                wrong += [] if found["texts"] == project.expected(mark) else [f"{mark}: wrong outputs, ok={found['ok']}"]
        except (NoEndError, RuntimeError) as error:
            wrong = [last_line(error)]
        row.count([f"edit at event {n}: {what}" for what in wrong])
    return row


def _edited_run(project: FlippedStore, nth: int) -> None:
    """A run during which a helper is edited at the nth event after it was opened."""
    runner = project.runner(1)
    graph, seen = project.graph(runner), []

    def watch(event: str, args: tuple[Any, ...]) -> None:
        if event not in WATCHED or len(seen) > nth:
            return
        if seen or (event == "open" and str(args[0]).endswith("helper.py")):
            seen.append(event)
        if len(seen) == nth + 1:
            seen.append("edited")
            project.edit(MARKS[0])

    sys.addaudithook(watch)
    runner.run(graph, "all")


def _same_second(plan: Plan, jobs: int) -> Row:
    """Edit within one second, like a script that tries one value after another."""
    row = Row(f"a constant of a helper edited to another of the same length within a second of the last run, jobs {jobs}")
    for n in range(plan.times(3, 1)):
        project = FlippedStore(plan.place(f"second-{jobs}-{n}"), ("ab",)).write()
        try:
            for mark in "?!?%":
                project.edit(mark)
                os.utime(project.code / "toy" / "helper.py", ns=(10**18, 10**18 + ord(mark)))
                found = apart(project.run, jobs)
                wrong = [] if found["texts"] == project.expected(mark) else [f"{mark}: {found['texts']}, ok={found['ok']}"]
                row.count(wrong)
        except (NoEndError, RuntimeError) as error:
            row.count([last_line(error)])
    return row


def _undone(plan: Plan) -> Row:
    row = Row("an edit made and undone while another run is open, then gc: current results stay")
    for n in range(plan.times(3, 1)):
        project = FlippedStore(plan.place(f"undone-{n}"), ("ab", "cd")).write()
        try:
            again = apart(_gc_after_undo, project)
            row.count([f"{again} tasks are not cached any more"] if again else [])
        except (NoEndError, RuntimeError) as error:
            row.count([last_line(error)])
    return row


def _gc_after_undo(project: FlippedStore) -> int:
    """Return the number of tasks that a plan would run after gc."""
    project.run(1)
    open_, graph = project.runner(1), project.graph(project.runner(1))
    for mark in MARKS:
        project.edit(mark)
        project.run(1)
    open_.run(graph, "all", force=["last"])
    project.runner().gc()
    return sum(plan.status != "cached" for plan in project.runner().plan(graph, "all"))
