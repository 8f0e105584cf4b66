"""1h: stages that crash, end their process, print, fork, close files, loop or are stopped. A shard fails alone; the run goes on."""

from __future__ import annotations

import importlib
import os
import signal
from typing import Any

from benchmarks.reliability import toy
from benchmarks.reliability.rows import Plan, Row
from benchmarks.reliability.signals import send
from runner import Graph, Runner
from tests.helpers.flipped_stores import FlippedStore

WORDS = ("ab", "cd", "ef", "gh", "ij", "kl")
BAD = "w1"
"""the shard that does it"""
STAGE = '''"""word -> the same word; one shard does what TOY_BAD names"""

from __future__ import annotations

import ctypes
import os
import sys
import time

from toy.log import note
from toy.values import Word


def recurse(n: int) -> int:
    return recurse(n + 1) + 1


def fork() -> None:
    if os.fork() == 0:
        time.sleep(0.3)
        os._exit(0)


def run(word: Word) -> Word:
    note("bad", word.name)
    deed = os.environ.get("TOY_BAD", "") if word.name == "w1" else ""
    if deed == "segfault":
        ctypes.string_at(0)
    elif deed == "_exit(0)":
        os._exit(0)
    elif deed == "SystemExit":
        raise SystemExit(0)
    elif deed == "KeyboardInterrupt":
        raise KeyboardInterrupt
    elif deed == "MemoryError":
        bytearray(1 << 62)
    elif deed == "endless recursion":
        recurse(0)
    elif deed == "prints 5 MB":
        for _ in range(500):
            print("x" * 10_000)
            os.write(1, b"y" * 500)
    elif deed == "forks":
        fork()
    elif deed == "closes its files":
        os.closerange(3, 64)
    elif deed == "endless loop":
        while True:
            time.sleep(0.01)
    elif deed == "busy loop":
        while True:
            pass
    return Word(word.name, word.text)
'''
GOOD = ("prints 5 MB", "forks")
"""what a stage may do"""
LATE = ("closes its files",)
"""done by a stage whose output is stored before its worker ends; the run may fail the shard, or succeed"""
DEEDS = ("segfault", "_exit(0)", "SystemExit", "KeyboardInterrupt", "MemoryError", "endless recursion", *GOOD, "closes its files")
ENDS = {"segfault": "there is no process but the run's own", "_exit(0)": "there is no process but the run's own",
        "KeyboardInterrupt": "it is Ctrl-C in the run's own process", "closes its files": "they are the run's own"}  # fmt: skip
"""what ends a run with jobs 0, by design"""


class BadStore(FlippedStore):
    """word -> bad -> shout -> join, 6 words."""

    def write(self) -> BadStore:
        """Write the project with an additional stage."""
        super().write()
        (self.code / "toy" / "bad.py").write_text(STAGE)
        return self

    def graph(self, runner: Runner, sleep_s: float = 0.0) -> Graph:
        """13 tasks."""
        bad, join, shout, values = (importlib.import_module(f"toy.{name}") for name in ("bad", "join", "shout", "values"))
        g = Graph()
        word = g.each(g.leaf("words", tuple(values.Word(f"w{i}", text) for i, text in enumerate(self.words))))
        loud = g.add(shout.run, part=g.add(bad.run, word=word), word=word, params=shout.Params(sleep_s=sleep_s))
        g.target("all", g.add(join.run, words=g.collect(loud)))
        return g

    def expected(self, mark: str = "!") -> dict[str, list[str]]:
        """The texts that a right run ends with."""
        return {"join": [" ".join(word.upper() + mark for word in self.words)]}

    @property
    def tasks(self) -> int:
        """Tasks of the graph."""
        return 2 * len(self.words) + 1


def rows(plan: Plan) -> list[Row]:
    """Run every misbehaviour with workers and in one process, then those that only Ctrl-C ends."""
    found = [_deed(plan, deed, jobs) for jobs in (2, 0) for deed in DEEDS]
    loops = [_loop(plan, deed, jobs, False) for deed in ("endless loop", "busy loop") for jobs in (2, 0)]
    return [*found, *loops, _loop(plan, "endless loop", 2, True)]


def _deed(plan: Plan, deed: str, jobs: int) -> Row:
    row = Row(f"a stage: {deed}, jobs {jobs}")
    project = BadStore(plan.place(f"{deed} {jobs}"), WORDS).write()
    process = toy.start(project, jobs, TOY_BAD=deed)
    ended = toy.end(process, 60.0)
    design = not jobs and deed in ENDS and ended.code is not None and not ended.report
    wrong = [] if design else toy.wrong_end(project, ended) if deed in GOOD else _fails_alone(project, ended)
    if deed in LATE and not toy.wrong_end(project, ended):
        wrong = []
    if not jobs and deed == "KeyboardInterrupt" and not design:
        wrong = []  # failing the shard alone would be right, too
    row.count(wrong + toy.wrong_later(project, toy.descendants(process.pid), _kept(project, ended)))
    if design and row.held:
        row.held, row.design, row.reason = 0, 1, f"{ENDS[deed]}: the run ends, and the next one goes on"
    return row


def _kept(project: FlippedStore, ended: toy.Ended) -> set[str]:
    """Keys that need not be executed again. A join of what was left is another task than that of all."""
    keys = toy.finished(project)
    return set(sorted(keys)[1:]) if "join" in ended.report.get("ran", {}) and not ended.report["ok"] else keys


def _fails_alone(project: FlippedStore, ended: toy.Ended) -> list[str]:
    if ended.code != 1:
        return [f"exit {ended.code}: {(ended.stderr or 'no message').splitlines()[-1]}"]
    report: dict[str, Any] = ended.report
    shards = [failure.partition(":")[0] for failure in report["failures"]]
    wrong = [] if shards == [f"bad {BAD}"] else [f"failed: {report['failures']}"]
    rest = " ".join(word.upper() + "!" for n, word in enumerate(project.words) if f"w{n}" != BAD)
    return wrong + ([] if report["texts"] == {"join": [rest]} else [f"outputs {report['texts']}"])


def _loop(plan: Plan, deed: str, jobs: int, stopped: bool) -> Row:
    row = Row(f"a stage: {deed}{', its worker stopped (SIGSTOP)' if stopped else ''}, jobs {jobs}: Ctrl-C ends it")
    project = BadStore(plan.place(f"{deed} {jobs} {stopped}"), WORDS).write()
    process = toy.start(project, jobs, TOY_BAD=deed)
    toy.wait_for(project, f"bad {BAD}")
    pids = toy.descendants(process.pid)
    for pid in pids if stopped else ():
        os.kill(pid, signal.SIGSTOP)
    send(process, (signal.SIGINT,))
    ended = toy.end(process, 30.0)
    wrong = [] if ended.code == 130 else [f"exit {ended.code}: {ended.stderr[-200:]}"]
    row.count(wrong + toy.wrong_later(project, pids))
    return row
