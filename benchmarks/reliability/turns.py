"""2: a task that needs several cores gets its turn while tasks of one core keep coming."""

from __future__ import annotations

import importlib

from benchmarks.reliability import toy
from benchmarks.reliability.rows import Plan, Row
from runner import Graph, Runner
from tests.helpers.flipped_stores import FlippedStore

NARROW, SLEEP_S = 60, 0.2
LATEST = 0.5
"""share of the narrow tasks that may begin before the wide one"""
STAGE = '''"""A word -> the same, with two cores"""

from __future__ import annotations

from toy.log import note
from toy.values import Word

THREADS = 2


def run(word: Word) -> Word:
    note("wide", word.name)
    return word
'''


class WideStore(FlippedStore):
    """60 narrow tasks and a wide one behind another."""

    def write(self) -> WideStore:
        """Write the project with the wide stage."""
        super().write()
        (self.code / "toy" / "wide.py").write_text(STAGE)
        return self

    def graph(self, runner: Runner, sleep_s: float = 0.0) -> Graph:
        """Narrow: word -> shout, one a word. Wide: a word -> shout -> wide, both of which the graph wants first."""
        shout, values, wide = (importlib.import_module(f"toy.{name}") for name in ("shout", "values", "wide"))
        g = Graph()
        word = g.each(g.leaf("words", tuple(values.Word(f"w{i}", text) for i, text in enumerate(self.words))))
        loud = g.add(shout.run, part=word, word=word, params=shout.Params(sleep_s=sleep_s))
        one = g.leaf("one", values.Word("one", "x"))
        early = g.first(g.named("early").add(shout.run, part=one, word=one, params=shout.Params(sleep_s=3 * sleep_s)))
        g.target("all", loud, g.first(g.add(wide.run, word=early)))
        return g

    def expected(self, mark: str = "!") -> dict[str, list[str]]:
        """The texts that a right run ends with."""
        return {"shout": [word.upper() + mark for word in self.words], "wide": ["X" + mark]}

    @property
    def tasks(self) -> int:
        """Tasks of the graph."""
        return len(self.words) + 2


def rows(plan: Plan) -> list[Row]:
    """Two workers, a wide task for both."""
    row = Row(f"a task of two cores among {NARROW} of one, jobs 2: it begins before {LATEST:.0%} of them have")
    places = []
    for n in range(plan.times(3, 1)):
        project = WideStore(plan.place(f"wide-{n}"), tuple(f"t{i:02d}" for i in range(NARROW))).write()
        wrong = toy.wrong_end(project, toy.run(project, 2, SLEEP_S))
        lines = [line.split()[0] for line in project.log.read_text().splitlines()]
        places.append(lines.index("wide") if "wide" in lines else len(lines))
        row.count(wrong + ([f"{places[-1]} of {NARROW} narrow tasks began before it"] if places[-1] > LATEST * NARROW else []))
    row.figures = f"narrow tasks that began before it: {', '.join(map(str, places))}"
    return [row]
