"""Work of the scheduler grows in proportion to the tasks: planning, running, failing, healing, provenance, two-level fan-outs."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from toy import join, pair, shout, split
from toy.values import Word
from toy_project import Project

from runner import Graph
from tests.runner.test_on_demand import remove

SMALL, LARGE = 40, 160
SLACK = 1.3
"""calls for LARGE words may exceed LARGE / SMALL times those for SMALL words by this factor"""


def words(count: int, text: str = "a{}", parts: int = 2) -> Graph:
    """Words -> parts -> capitals -> pairs -> one word, and the first word of each list beside all parts."""
    g = Graph()
    word = g.each(g.leaf("words", tuple(Word(f"w{i}", text.format(i)) for i in range(count))))
    part = g.each(g.add(split.run, word=word, params=split.Params(parts=parts)))
    loud = g.add(shout.run, part=part, word=word, params=shout.Params())
    first = g.pick(g.add(pair.run, word=loud), lambda both: both.left)
    g.target("all", g.add(join.run, words=g.collect(first)))  # type: ignore[call-arg]
    return g


def calls(work: Callable[[], Any]) -> int:
    """Count the calls of Python functions of the engine."""
    count = 0

    def profile(frame: Any, event: str, _: Any) -> None:
        nonlocal count
        count += event == "call" and f"{Path('runner')}/" in frame.f_code.co_filename

    sys.setprofile(profile)
    try:
        work()
    finally:
        sys.setprofile(None)
    return count


def cold(project: Project, count: int) -> Callable[[], Any]:
    return lambda: project.runner().run(words(count), "all")


def nothing(project: Project, count: int) -> Callable[[], Any]:
    project.runner().run(words(count), "all")
    return lambda: project.runner().run(words(count), "all")


def failing(project: Project, count: int) -> Callable[[], Any]:
    return lambda: project.runner().run(words(count, "bad {}"), "all")


def dropped(project: Project, count: int) -> Callable[[], Any]:
    project.runner().run(words(count), "all")
    remove(project, "split", "shout", "pair")
    return lambda: project.runner().run(words(count), "all", force=["join"])


def planned(project: Project, count: int) -> Callable[[], Any]:
    project.runner().run(words(count), "all")
    remove(project, "split", "shout", "pair")
    return lambda: project.runner().plan(words(count), "all", force=["join"])


def traced(project: Project, count: int) -> Callable[[], Any]:
    report = project.runner().run(words(count), "all")
    return lambda: project.runner().lineage(report.outputs["join"][0][1])


def wide(project: Project, count: int) -> Callable[[], Any]:
    """One word of many parts, so that each part is below the same word."""
    return lambda: project.runner().run(words(2, parts=count), "all")


@pytest.mark.parametrize("case", [cold, nothing, failing, dropped, planned, traced, wide])
def test_the_work_is_proportional_to_the_tasks(case: Callable[[Project, int], Callable[[], Any]], tmp_path: Path) -> None:
    """Four times the words need about four times the calls."""
    found = {}
    for count in (SMALL, LARGE):
        project = Project.make(tmp_path / str(count))
        found[count] = calls(case(project, count))
    assert found[LARGE] < SLACK * found[SMALL] * LARGE / SMALL, found
