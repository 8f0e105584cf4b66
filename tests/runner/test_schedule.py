"""Order of tasks, fairness, skipped tasks, and the cost of one scheduler turn."""

from __future__ import annotations

from pathlib import Path

import pytest
from toy import join, pair, shout, split, wide
from toy.values import Word
from toy_project import Project, text

from runner import Graph
from runner.engines import Inline
from runner.keys import CodeFingerprints
from runner.report import Reason, RunReport, SilentObserver
from runner.resources import Budget
from runner.schedule import MAX_OVERTAKES, Limit, Schedule
from runner.task_planner import TaskPlanner
from runner.walk import Walk


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project.make(tmp_path)


@pytest.mark.parametrize("first", [True, False])
def test_a_wide_task_gets_its_turn(first: bool, project: Project) -> None:
    """The task needs both cores. A few narrow tasks overtake it, then it starts, however many narrow tasks are ready."""
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
    """Otherwise the cost would grow with the square of the number of tasks."""
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


def training_graph(*words: str, first: bool = True, model_is_wanted: bool = False) -> Graph:
    """Check words; train on four samples together; apply the trained model to every word."""
    g = Graph()
    word = g.each(g.leaf("words", tuple(Word(f"w{i}", text) for i, text in enumerate(words))))
    book = g.leaf("book", Word("book", "b"))
    sample = g.each(g.named("samples").add(split.run, word=book, params=split.Params(parts=4)))
    learned = g.named("learn").add(shout.run, part=sample, word=book, params=shout.Params())
    trained = g.named("train").add(join.run, words=g.collect(learned))  # type: ignore[call-arg]
    checked = g.named("check").add(shout.run, part=word, word=word, params=shout.Params())
    used = g.named("use").add(shout.run, part=g.first(checked) if first else checked, word=trained, params=shout.Params())
    g.target("all", g.add(join.run, words=g.collect(used)), *([trained] if model_is_wanted else []))  # type: ignore[call-arg]
    return g


@pytest.mark.parametrize("jobs", [0, 1])
def test_training_is_skipped_when_all_of_its_users_have_failed(project: Project, jobs: int) -> None:
    """Skipped tasks are reported as blocked, and the next run with a valid word executes all of them."""
    report = project.runner(jobs).run(training_graph("bad", "bad too"), "all")
    assert report.failed == {"check": 2} and not report.ran
    assert report.blocked == {"samples": 1, "use": 2, "join": 1, "train": 1}
    assert project.executed() == {"shout": 2}
    good = project.runner(jobs).run(training_graph("bad", "ok"), "all")
    assert good.ran == {"check": 1, "samples": 1, "learn": 4, "train": 1, "use": 1, "join": 1} and text(project, good) == "OK!!"


def test_one_valid_user_keeps_the_training(project: Project) -> None:
    report = project.runner().run(training_graph("bad", "ok", "bug"), "all")
    assert report.failed == {"check": 2} and report.ran["learn"] == 4 and text(project, report) == "OK!!"


def test_a_target_is_never_skipped(project: Project) -> None:
    """A failed sibling does not matter."""
    report = project.runner().run(training_graph("bad", model_is_wanted=True), "all")
    assert report.ran == {"samples": 1, "learn": 4, "train": 1}


def test_priority_tasks_precede_those_behind_a_collect(tmp_path: Path) -> None:
    """The list that a collect waits for comes first without priority; the outputs are the same."""
    order = []
    for first in (True, False):
        mine = Project.make(tmp_path / str(first))
        mine.runner().run(training_graph("ok", "good", first=first), "all")
        order.append([line.split()[1] for line in mine.log.read_text().splitlines()])
    assert order[0][:2] == ["w0", "w1"] and order[1][0] == "book"
    assert sorted(order[0]) == sorted(order[1])


@pytest.mark.parametrize("jobs", [0, 2])
def test_equal_tasks_of_many_shards_run_once(jobs: int, project: Project) -> None:
    """Each part of a word repeats the word itself: one task for all of them, whether they wait for it or come later."""
    g = Graph()
    word = g.each(g.leaf("words", (Word("w", "ab"),)))
    part = g.each(g.add(split.run, word=word, params=split.Params(parts=4)))
    g.target("all", g.add(pair.run, word=g.each(g.finished("both", (word, part)))))
    report = project.runner(jobs).run(g, "all")
    assert report.ok and (report.ran["pair"], report.cached["pair"]) == (5, 3)
    assert project.executed() == {"split": 1, "pair": 5}
