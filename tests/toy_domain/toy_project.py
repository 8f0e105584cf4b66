"""Copy of the toy domain that a test may edit, run and break."""

from __future__ import annotations

import os
import shutil
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toy import join, pair, shout, split
from toy.values import Word

from runner import Graph, Runner, RunReport

HERE = Path(__file__).resolve().parent


@dataclass
class Project:
    """`root` holds the code, `store` the artifacts, `log` a line per execution."""

    root: Path
    store: Path
    log: Path

    @classmethod
    def make(cls, folder: Path) -> Project:
        shutil.copytree(HERE / "toy", folder / "code" / "toy", ignore=shutil.ignore_patterns("__pycache__"))
        project = cls(folder / "code", folder / "store", folder / "log")
        os.environ["TOY_LOG"] = str(project.log)
        return project

    def runner(self, jobs: int = 0, **more: Any) -> Runner:
        return Runner(self.store, self.root, "toy.values:CODEC", None, jobs=jobs, **more)

    def run(self, *words: str, jobs: int = 0, params: shout.Params | None = None, **more: Any) -> RunReport:
        return self.runner(jobs).run(graph(*words, params=params), "all", **more)

    def edit(self, file: str, old: str, new: str) -> None:
        path = self.root / file
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new))

    def executed(self) -> Counter[str]:
        """Map each stage to its number of executions since the last call."""
        if not self.log.exists():
            return Counter()
        lines = self.log.read_text().split("\n")[:-1]
        self.log.unlink()
        return Counter(line.split()[0] for line in lines)


def graph(*words: str, params: shout.Params | None = None) -> Graph:
    """Build the graph: words -> parts -> capitals -> first letters -> one word."""
    g = Graph()
    word = g.each(g.leaf("words", tuple(Word(f"w{i}", text) for i, text in enumerate(words))))
    part = g.each(g.add(split.run, word=word, params=split.Params()))
    loud = g.add(shout.run, part=part, word=word, params=params or shout.Params())
    first = g.pick(g.add(pair.run, word=loud), lambda both: both.left)
    g.target("all", g.add(join.run, words=g.collect(first)), loud)  # type: ignore[call-arg]
    return g


def text(project: Project, report: RunReport) -> str:
    """Text of the output of `join`."""
    value = project.runner().load(report.outputs["join"][0][1])
    assert isinstance(value, Word)
    return value.text


def wait_until(condition: Any, seconds: float = 30.0) -> None:
    """Poll; fail when it takes too long."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.01)
