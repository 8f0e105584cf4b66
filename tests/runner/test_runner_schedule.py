"""Fairness of the schedule, and what a turn of it costs."""

from __future__ import annotations

from pathlib import Path

import pytest
from toy import shout, wide
from toy.values import Word
from toy_project import Project

from runner import Graph
from runner.engines import Inline
from runner.keys import CodeFingerprints
from runner.report import Reason, RunReport, SilentObserver
from runner.schedule import MAX_OVERTAKES, Budget, Limit, Schedule
from runner.task_planner import TaskPlanner
from runner.walk import Walk


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project.make(tmp_path)


@pytest.mark.parametrize("first", [True, False])
def test_a_wide_task_gets_its_turn(first: bool, project: Project) -> None:
    """It needs both cores. A few narrow ones overtake it, then it starts, however many narrow ones are ready."""
    g = Graph()
    narrow = g.each(g.leaf("narrow", tuple(Word(f"n{i:02}", "x") for i in range(20))))
    loud = g.add(shout.run, part=narrow, word=narrow, params=shout.Params(sleep_s=0.05))
    word = g.leaf("word", Word("w", "x"))
    early = g.named("early").add(shout.run, part=word, word=word, params=shout.Params(sleep_s=0.1))
    both = g.add(wide.run, word=early)
    g.target("all", g.first(both) if first else both, loud)
    assert project.runner(2).run(g, "all").ok
    log = project.log.read_text().split("\n")
    begun = log.index("shout w"), log.index("wide w")
    assert begun[1] - begun[0] <= 2 + 2 * MAX_OVERTAKES + 2, log


def test_a_turn_without_a_limit_does_not_touch_the_ready_list(project: Project) -> None:
    """Its cost would grow with the square of the number of tasks."""
    g = Graph()
    word = g.each(g.leaf("words", tuple(Word(f"n{i}", "x") for i in range(3))))
    g.target("all", g.add(shout.run, part=word, word=word, params=shout.Params()))
    runner = project.runner()
    desk = TaskPlanner(runner.store, runner.traces, CodeFingerprints(runner.modules, "toy.values:CODEC", None))
    for limit in (Limit(), Limit(end=float("1e18"), optional=frozenset({0, 1, 2}))):
        schedule = Schedule(desk, Inline(runner.worker_spec), Budget(1, 1.0), SilentObserver(), RunReport(""), limit)
        schedule.walk = Walk(g, runner._wanted(g, "all"), desk, schedule)
        schedule.walk.begin()
        ready = schedule._ready
        schedule._defer_late()
        assert schedule._ready is ready and len(ready) == 3 and isinstance(ready[0][3], Reason)
