"""What goes first, and what is not worth doing any more."""

from __future__ import annotations

from pathlib import Path

import pytest
from toy import join, shout, split
from toy.values import Word
from toy_project import Project, text

from runner import Graph


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project.make(tmp_path)


def school(*words: str, first: bool = True, told: bool = False) -> Graph:
    """Words are checked; four lessons are learned from, together; what was learned is used on every word."""
    g = Graph()
    word = g.each(g.leaf("words", tuple(Word(f"w{i}", text) for i, text in enumerate(words))))
    book = g.leaf("book", Word("book", "b"))
    lesson = g.each(g.named("lessons").add(split.run, word=book, params=split.Params(parts=4)))
    learned = g.named("learn").add(shout.run, part=lesson, word=book, params=shout.Params())
    taught = g.named("teach").add(join.run, words=g.collect(learned))  # type: ignore[call-arg]
    checked = g.named("check").add(shout.run, part=word, word=word, params=shout.Params())
    used = g.named("use").add(shout.run, part=g.first(checked) if first else checked, word=taught, params=shout.Params())
    g.target("all", g.add(join.run, words=g.collect(used)), *([taught] if told else []))  # type: ignore[call-arg]
    return g


@pytest.mark.parametrize("jobs", [0, 1])
def test_nothing_is_learned_for_those_who_failed(project: Project, jobs: int) -> None:
    """What nobody can use is not made; it is said to be blocked, and the next run with a good word makes all of it."""
    report = project.runner(jobs).run(school("bad", "bad too"), "all")
    assert report.failed == {"check": 2} and not report.ran
    assert report.blocked == {"lessons": 1, "use": 2, "join": 1, "teach": 1}
    assert project.executed() == {"shout": 2}
    good = project.runner(jobs).run(school("bad", "ok"), "all")
    assert good.ran == {"check": 1, "lessons": 1, "learn": 4, "teach": 1, "use": 1, "join": 1} and text(project, good) == "OK!!"


def test_one_that_is_whole_is_reason_enough(project: Project) -> None:
    report = project.runner().run(school("bad", "ok", "bug"), "all")
    assert report.failed == {"check": 2} and report.ran["learn"] == 4 and text(project, report) == "OK!!"


def test_what_is_asked_for_is_made_whoever_fails(project: Project) -> None:
    """A target itself is never useless."""
    report = project.runner().run(school("bad", told=True), "all")
    assert report.ran == {"lessons": 1, "learn": 4, "teach": 1}


def test_what_goes_first_goes_before_what_others_wait_for(tmp_path: Path) -> None:
    """Else the list that a collect waits for comes first; the same is made either way."""
    order = []
    for first in (True, False):
        mine = Project.make(tmp_path / str(first))
        mine.runner().run(school("ok", "good", first=first), "all")
        order.append([line.split()[1] for line in mine.log.read_text().splitlines()])
    assert order[0][:2] == ["w0", "w1"] and order[1][0] == "book"
    assert sorted(order[0]) == sorted(order[1])
