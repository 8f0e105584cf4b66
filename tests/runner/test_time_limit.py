"""Runs with a time limit: finished results are reported, unfinished ones are deferred to the next run."""

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
    """Graph of a report on optional rows: each word in capitals, the slow one after `slow_s` seconds."""
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


def test_a_limit_of_zero_defers_all_rows(project: Project) -> None:
    """The table is empty and nothing fails; the next run computes the rows and the same table as an unlimited run."""
    report = project.runner().run(table(("a", "b")), "table", limit_s=0.0)
    assert report.ok and report.deferred == {"shout_0": 1, "shout_1": 1} and report.ran == {"join": 1}
    assert shown(project, report) == ""
    whole = project.runner().run(table(("a", "b")), "table")
    assert shown(project, whole) == "A! B!" and not whole.deferred
    assert project.runner().run(table(("a", "b")), "table", limit_s=0.0).outputs == whole.outputs, "what is there is no work"


def test_a_running_task_is_stopped_at_the_limit(project: Project) -> None:
    """Finished rows are in the table, the worker of the slow row is gone, and its key is free."""
    began = time.monotonic()
    report = project.runner(2).run(table(("a", "b"), "c", 60.0), "table", limit_s=3.0)
    assert time.monotonic() - began < 30
    assert report.ok and report.deferred == {"shout_slow": 1} and shown(project, report) == "A! B!"
    for path in (project.store / "leases").glob("*.lock"):
        wait_until(lambda path=path: Lease(path).held)


def test_a_list_is_complete_or_deferred(project: Project) -> None:
    """A plain collect is not built from some of its elements, also if the list itself is deferred."""
    g = Graph()
    word = g.each(g.leaf("words", (Word("w0", "ab"), Word("w1", "cd"))))
    part = g.each(g.add(split.run, word=word, params=split.Params()))
    data = g.add(join.run, words=g.collect(part))  # type: ignore[call-arg]
    g.target("table", g.named("page").add(join.run, words=g.finished("data", [data])))
    report = project.runner().run(g, "table", limit_s=0.0)
    assert report.deferred == {"split": 2, "join": 1} and report.ran == {"page": 1}


def test_a_partial_collect_takes_what_is_there(project: Project) -> None:
    """Available elements of an axis, in order."""
    def made(texts: str) -> Graph:
        g = Graph()
        word = g.each(g.leaf("words", tuple(Word(text, text) for text in texts)))
        loud = g.add(shout.run, part=word, word=word, params=shout.Params())
        g.target("table", g.add(join.run, words=g.collect(loud, partial=True)))  # type: ignore[call-arg]
        return g

    project.runner().run(made("ac"), "table")
    report = project.runner().run(made("abc"), "table", limit_s=0.0)
    assert report.deferred == {"shout": 1} and shown(project, report) == "A! C!"


def test_finished_omits_failures(project: Project) -> None:
    """`finished` omits failed elements, and is blocked when there are no others."""
    report = project.runner().run(table(("a", "bad")), "table")
    assert report.failed == {"shout_1": 1} and shown(project, report) == "A!"
    assert project.runner().run(table(("bad", "bug")), "table").blocked == {"join": 1}


def test_a_target_without_optional_parts_takes_no_limit(project: Project) -> None:
    """A data set has no optional parts."""
    with pytest.raises(NothingOptionalError, match="all has no optional parts"):
        project.run("ab", limit_s=1.0)


def test_a_required_task_runs_after_the_limit(project: Project) -> None:
    """A row that is itself a target."""
    g = Graph()
    word = g.leaf("word", Word("w", "x"))
    loud = g.add(shout.run, part=word, word=word, params=shout.Params())
    other = g.named("other").add(shout.run, part=word, word=word, params=shout.Params(backend="other"))
    g.target("table", g.add(join.run, words=g.finished("rows", [loud, other])), loud)  # type: ignore[call-arg]
    report = project.runner().run(g, "table", limit_s=0.0)
    assert report.ran == {"shout": 1, "join": 1} and report.deferred == {"other": 1}


def test_equally_deep_tasks_run_in_order(project: Project) -> None:
    """The first rows are finished at the limit; a shard still reaches the end before another begins."""
    project.runner().run(table(("a", "b", "c")), "table")
    lines = [line.split()[1] for line in project.log.read_text().split("\n") if line.startswith("shout")]
    assert lines == ["w0", "w1", "w2"]
    project.executed()
    project.runner().run(graph("ab", "cd"), "all")
    order = [line.split()[0] for line in project.log.read_text().split("\n")[:4]]
    assert order == ["split", "shout", "pair", "shout"]


def test_tasks_behind_an_intermediate_collect_go_first(project: Project) -> None:
    """Users of the list cannot begin without them, although other tasks are deeper."""
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
