"""A run that has only so long: what is finished by then is told of, what is not is left whole for the next run."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from toy import join, shout, split
from toy.values import Word
from toy_project import Project, graph, wait_until

from runner import Graph, NothingOptionalError, RunReport
from runner.lease import Lease


@pytest.fixture
def project(tmp_path: Path) -> Project:
    return Project.make(tmp_path)


def table(quick: tuple[str, ...], slow: str = "", sleep_s: float = 0.0) -> Graph:
    """Rows of a table that a report can do without: each word in capitals, the slow one after so long."""
    g = Graph()
    words = [g.leaf(f"word{i}", Word(f"w{i}", text)) for i, text in enumerate(quick)]
    rows = [g.named(f"shout_{i}").add(shout.run, part=word, word=word, params=shout.Params()) for i, word in enumerate(words)]
    if slow:
        last = g.leaf("last", Word("slow", slow))
        rows.append(g.named("shout_slow").add(shout.run, part=last, word=last, params=shout.Params(sleep_s=sleep_s)))
    g.target("table", g.add(join.run, words=g.finished("rows", rows)))  # type: ignore[call-arg]
    return g


def shown(project: Project, report: RunReport) -> str:
    value = project.runner().load(report.outputs["join"][0][1])
    assert isinstance(value, Word)
    return value.text


def test_without_any_time_everything_is_left_but_what_tells_of_it(project: Project) -> None:
    """An empty table, nothing failed; the next run makes what was left, and the same table as one that had the time."""
    report = project.runner().run(table(("a", "b")), "table", limit_s=0.0)
    assert report.ok and report.deferred == {"shout_0": 1, "shout_1": 1} and report.ran == {"join": 1}
    assert shown(project, report) == ""
    whole = project.runner().run(table(("a", "b")), "table")
    assert shown(project, whole) == "A! B!" and not whole.deferred
    assert project.runner().run(table(("a", "b")), "table", limit_s=0.0).outputs == whole.outputs, "what is there is no work"


def test_what_runs_when_the_time_is_over_is_stopped(project: Project) -> None:
    """Finished rows are told of, the worker at the slow one is gone, and its key is free."""
    began = time.monotonic()
    report = project.runner(2).run(table(("a", "b"), "c", 60.0), "table", limit_s=3.0)
    assert time.monotonic() - began < 30
    assert report.ok and report.deferred == {"shout_slow": 1} and shown(project, report) == "A! B!"
    for path in (project.store / "leases").glob("*.lock"):
        wait_until(lambda path=path: Lease(path).held)


def test_a_list_is_whole_or_left(project: Project) -> None:
    """What goes through a plain collect is not made of half of its elements, also where the list itself is late."""
    g = Graph()
    word = g.each(g.leaf("words", (Word("w0", "ab"), Word("w1", "cd"))))
    part = g.each(g.add(split.run, word=word, params=split.Params()))
    data = g.add(join.run, words=g.collect(part))  # type: ignore[call-arg]
    g.target("table", g.named("page").add(join.run, words=g.finished("data", [data])))
    report = project.runner().run(g, "table", limit_s=0.0)
    assert report.deferred == {"split": 2, "join": 1} and report.ran == {"page": 1}


def test_a_partial_collect_takes_what_is_there(project: Project) -> None:
    """Of an axis, in order."""
    def made(texts: str) -> Graph:
        g = Graph()
        word = g.each(g.leaf("words", tuple(Word(text, text) for text in texts)))
        loud = g.add(shout.run, part=word, word=word, params=shout.Params())
        g.target("table", g.add(join.run, words=g.collect(loud, partial=True)))  # type: ignore[call-arg]
        return g

    project.runner().run(made("ac"), "table")
    report = project.runner().run(made("abc"), "table", limit_s=0.0)
    assert report.deferred == {"shout": 1} and shown(project, report) == "A! C!"


def test_of_what_fails_the_rest_is_told(project: Project) -> None:
    """`finished` leaves failures out, and is blocked when nothing else is there."""
    report = project.runner().run(table(("a", "bad")), "table")
    assert report.failed == {"shout_1": 1} and shown(project, report) == "A!"
    assert project.runner().run(table(("bad", "bug")), "table").blocked == {"join": 1}


def test_what_has_nothing_to_leave_takes_no_limit(project: Project) -> None:
    """A data set is made whole or not at all."""
    with pytest.raises(NothingOptionalError, match="all has no optional parts"):
        project.run("ab", limit_s=1.0)


def test_what_is_needed_is_made_however_late_it_is(project: Project) -> None:
    """A row that is itself asked for."""
    g = Graph()
    word = g.leaf("word", Word("w", "x"))
    loud = g.add(shout.run, part=word, word=word, params=shout.Params())
    other = g.named("other").add(shout.run, part=word, word=word, params=shout.Params(backend="other"))
    g.target("table", g.add(join.run, words=g.finished("rows", [loud, other])), loud)  # type: ignore[call-arg]
    report = project.runner().run(g, "table", limit_s=0.0)
    assert report.ran == {"shout": 1, "join": 1} and report.deferred == {"other": 1}


def test_of_equally_deep_tasks_the_first_goes_first(project: Project) -> None:
    """So that of many rows the first ones are finished when time is over; a shard still goes to its end before another begins."""
    project.runner().run(table(("a", "b", "c")), "table")
    lines = [line.split()[1] for line in project.log.read_text().split("\n") if line.startswith("shout")]
    assert lines == ["w0", "w1", "w2"]
    project.executed()
    project.runner().run(graph("ab", "cd"), "all")
    order = [line.split()[0] for line in project.log.read_text().split("\n")[:4]]
    assert order == ["split", "shout", "pair", "shout"]


def test_what_a_collect_before_the_last_waits_for_goes_first(project: Project) -> None:
    """It is less deep than what stands beside it, but who uses the list cannot begin, and would be alone in the end."""
    g = Graph()
    quick, word = g.leaf("quick", Word("q", "x")), g.leaf("word", Word("w", "y"))
    deep = g.named("deep").add(shout.run, part=g.named("first").add(shout.run, part=quick, word=quick, params=shout.Params()),
                               word=quick, params=shout.Params())  # fmt: skip
    late = g.named("late").add(shout.run, part=word, word=word, params=shout.Params())
    joined = g.named("joined").add(join.run, words=g.collect(late))  # type: ignore[call-arg]
    g.target("table", g.named("table").add(join.run, words=g.finished("rows", [deep, joined])))  # type: ignore[call-arg]
    report = project.runner().run(g, "table")
    assert report.ok
    lines = [line.split()[:2] for line in project.log.read_text().split("\n") if line.startswith("shout")]
    assert [name for _, name in lines] == ["w", "q", "q"]
