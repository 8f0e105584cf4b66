"""Toy stores with every kind of file, ways to damage each, and steps in processes that are killed when they hang."""

from __future__ import annotations

import importlib
import json
import multiprocessing
import os
import random
import re
import shutil
import signal
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext
from pathlib import Path
from typing import Any

from runner import Graph, Runner

TOY = Path(__file__).parents[1].joinpath("toy_domain") / "toy"
LIMIT_S = 30.0
"""a step on a toy store takes a second; one that needs this long does not end"""
FIELD = re.compile(rb'"(\w+)":')
CACHES = ("index", "modules", "blobs", "files")
KINDS = ("blob", "segment", "code", "failure", "format", *(f".cache/{name}" for name in CACHES))
"""kinds of file in a store; a failure is a row of a segment"""
STORED = ("blob", "segment")
"""kinds whose damage `verify` reports"""
FORMER = ("segment", "blob")
"""kinds of which results of former code hold some that nothing uses any more"""
NEVER_MADE = ("segment", "remove")
"""a task without a trace is one that was never finished"""
DAMAGES = ("flip", "cut", "remove", "{}", "[]", "null", "field")
MEASURE = '''"""A file outside the store -> its size"""

from __future__ import annotations

from toy.log import note
from toy.values import Outside, Word


def run(file: Outside) -> Word:
    note("measure", file.name)
    return Word(file.name, str(file.path.stat().st_size))
'''


class NoEndError(Exception):
    """A step did not end, or its process died."""


@dataclass(frozen=True)
class FlippedStore:
    """A toy project in `folder`: code, store, a log of executions, and a file outside the store."""

    folder: Path
    words: tuple[str, ...] = ("ab", "cd")

    @property
    def code(self) -> Path:
        return self.folder / "code"

    @property
    def store(self) -> Path:
        return self.folder / "store"

    @property
    def log(self) -> Path:
        return self.folder / "log"

    def write(self) -> FlippedStore:
        """Write the code and the outside file, old enough for digests and parsed modules to be remembered."""
        shutil.copytree(TOY, self.code / "toy", ignore=shutil.ignore_patterns("__pycache__"))
        (self.code / "toy" / "measure.py").write_text(MEASURE)
        (self.folder / "outside.bin").write_bytes(b"x" * 1000)
        for path in (*self.code.rglob("*.py"), self.folder / "outside.bin"):
            os.utime(path, ns=(10**18, 10**18))
        return self

    def edit(self, mark: str) -> None:
        """Change a constant in a helper of `shout`."""
        path = self.code / "toy" / "helper.py"
        path.write_text(re.sub('MARK = ".*"', f'MARK = "{mark}"', path.read_text()))

    def runner(self, jobs: int = 0, **more: Any) -> Runner:
        """Open a runner in this process, which imports this project's own copy of the toy domain."""
        self.enter()
        return Runner(self.store, self.code, "toy.values:CODEC", None, jobs=jobs, **more)

    def enter(self) -> None:
        """Let this process import this project's own copy of the toy domain."""
        if sys.path[0] != str(self.code):
            sys.path.insert(0, str(self.code))
            importlib.invalidate_caches()
            for name in [name for name in sys.modules if name.partition(".")[0] == "toy"]:
                del sys.modules[name]
        os.environ["TOY_LOG"] = str(self.log)

    def graph(self, runner: Runner, sleep_s: float = 0.0) -> Graph:
        """Build a graph with every form of node: list, each, stage, pick, gather and collect; 8 tasks a word and 3 more."""
        join, measure, pair, shout, split, values = (
            importlib.import_module(f"toy.{name}") for name in ("join", "measure", "pair", "shout", "split", "values"))
        g, loud = Graph(), shout.Params(sleep_s=sleep_s)
        word = g.each(g.leaf("words", tuple(values.Word(f"w{i}", text) for i, text in enumerate(self.words))))
        part = g.each(g.add(split.run, word=word, params=split.Params()))
        both = g.add(pair.run, word=g.add(shout.run, part=part, word=word, params=loud))
        left, right = g.pick(both, lambda both: both.left), g.pick(both, lambda both: both.right)
        echo = g.named("echo").add(shout.run, part=word, word=word, params=loud)
        gathered = g.named("gathered").add(join.run, words=(left, right))
        path = self.folder / "outside.bin"
        size = g.add(measure.run, file=g.leaf("outside", values.Outside("outside", runner.hash_file(path)[0], path)))
        line = g.add(join.run, words=g.collect(left))
        g.target("all", g.named("last").add(join.run, words=(line, size)), gathered, echo, *self.more(g, word))
        return g

    def more(self, g: Graph, word: Any) -> tuple[Any, ...]:
        """Further outputs, made of each word."""
        return ()

    def expected(self, mark: str = "!") -> dict[str, list[str]]:
        """Texts of a correct run."""
        loud = [f"{word}{i}".upper() + mark for word in self.words for i in range(2)]
        return {"last": [" ".join([*(text[:1] for text in loud), "1000"])],
                "gathered": [f"{text[:1]} {text[1:]}" for text in loud], "echo": [word.upper() + mark for word in self.words]}

    @property
    def tasks(self) -> int:
        """Tasks of the graph."""
        return 8 * len(self.words) + 3

    # -- steps, each for a process of its own ----------------------------------------------------------------------------

    def run(self, jobs: int = 0, sleep_s: float = 0.0, **more: Any) -> dict[str, Any]:
        """Report of a run, and the texts of its outputs, read through the store."""
        runner = self.runner(jobs)
        report = runner.run(self.graph(runner, sleep_s), "all", **more)
        return {"ok": report.ok, "ran": dict(report.ran), "outputs": dict(report.outputs), "texts": self.texts(runner, report),
                "failures": [f"{failure.stage} {failure.shard}: {failure.message}" for failure in report.failures]}

    def texts(self, runner: Runner, report: Any) -> dict[str, list[str]]:
        """Map each output to its texts."""
        return {stage: [runner.load(digest).text for _, digest in made] for stage, made in report.outputs.items()}

    def verify(self) -> bool:
        """Return True when `verify` finds nothing."""
        return self.runner().verify().ok

    def failed(self) -> list[str]:
        """Shards that the store lists as failed."""
        return sorted(row["shard"] for row in self.runner().failures())

    def keys(self) -> set[str]:
        """Keys of all tasks with the present code."""
        runner = self.runner()
        return {plan.key for plan in runner.plan(self.graph(runner), "all")}

    # -- damage ----------------------------------------------------------------------------------------------------------

    def files(self, kind: str) -> list[Path]:
        """Files of a kind."""
        if kind.startswith(".cache/"):
            found = self.store.glob(f"{kind}*")
        else:
            found = self.store.glob({"blob": "blobs/??/*", "code": "code/*", "format": "format"}.get(kind, "traces/*"))
        return sorted(path for path in found if path.is_file() and not path.name.startswith("."))

    def fill_caches(self) -> None:
        """Write the index, and let every blob be hashed again, so that its new change time is remembered."""
        for path in self.files("blob"):
            path.chmod(0o400)
            path.chmod(0o444)
        runner = self.runner()
        runner.run(self.graph(runner), "all")
        runner.index.write()


def damage(path: Path, how: str, rng: random.Random) -> str:
    """Damage a file, and keep its modification time; return a description."""
    before, data = path.stat(), path.read_bytes()
    if how == "remove":
        path.unlink()
        return f"{path.name} removed"
    spoilt, change = _spoilt(data, how, rng)
    path.chmod(0o644)
    path.write_bytes(spoilt)
    path.chmod(before.st_mode & 0o7777)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    return f"{path.name} {change}"


def _spoilt(data: bytes, how: str, rng: random.Random) -> tuple[bytes, str]:
    at = rng.randrange(len(data))
    if how == "flip":
        flipped = data[at] ^ (1 << rng.randrange(8))
        return data[:at] + bytes([flipped]) + data[at + 1 :], f"byte {at}: {data[at : at + 1]!r} -> {bytes([flipped])!r}"
    if how == "cut":
        return data[:at], f"cut to {at} bytes"
    names = list(FIELD.finditer(data))
    if how == "field" and names:
        name = rng.choice(names)
        return data[: name.start(1)] + b"x" + data[name.start(1) + 1 :], f"field {name[1].decode()} misspelt"
    text = b"7" if how == "field" else how.encode()
    return text, f"replaced by {text.decode()}"


def apart(work: Callable[..., Any], *args: Any, limit_s: float = LIMIT_S, **more: Any) -> Any:
    """Call a function in its own process and return the result.

    NoEndError when the process dies or is killed after `limit_s`, RuntimeError with the traceback when the function raises.
    """
    ours, theirs = multiprocessing.Pipe(duplex=False)
    process = _small_server().Process(target=_answer, args=(theirs, work, args, more))
    process.start()
    theirs.close()
    try:
        if not ours.poll(limit_s):
            raise NoEndError(f"{work.__name__} did not end within {limit_s:.0f} s")
        raised, result = ours.recv()
    except EOFError:
        process.join()
        raise NoEndError(f"{work.__name__}: the process ended with {process.exitcode}") from None
    finally:
        process.kill()
        process.join()
        ours.close()
    if raised:
        raise RuntimeError(result)
    return result


@cache
def _small_server() -> ForkServerContext:
    """Processes forked from a small one, since a fork of the test process copies the page tables of all that it holds."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.helpers.random_stories"])
    return context


def _answer(pipe: Connection, work: Callable[..., Any], args: tuple[Any, ...], more: dict[str, Any]) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        pipe.send((False, work(*args, **more)))
    except Exception:
        pipe.send((True, traceback.format_exc()))


def last_line(error: BaseException) -> str:
    """Last line of a message."""
    return str(error).strip().splitlines()[-1]


def healed(project: FlippedStore, kind: str, how: str, rng: random.Random, *, cache: bool, verify_first: bool) -> list[str]:
    """Damage one file of a kind, run, and return the problems; an empty list where the law holds.

    cache: keep .cache. verify_first: run `verify` before the run, which must report damage of stored files.
    """
    mark, wrong = "!", []
    change = damage(rng.choice(project.files(kind)), how, rng)
    if not cache:
        shutil.rmtree(project.store / ".cache")
    try:
        if kind == "failure":
            apart(project.failed)
        if verify_first and apart(project.verify) and kind in STORED and (kind, how) != NEVER_MADE:
            wrong.append("verify before the run reports nothing")
        if kind == "code":
            mark = "?"
            project.edit(mark)
        found = apart(project.run)
        if kind == "failure":
            wrong += [] if apart(project.failed) == ["w2", "w2/w2.0", "w2/w2.1"] else ["the list of failures is wrong"]
        elif not found["ok"]:
            wrong.append(f"the run failed: {'; '.join(found['failures'][:2])}")
        elif found["texts"] != project.expected(mark):
            wrong.append(f"wrong outputs: {json.dumps(found['texts'])}")
        wrong += [] if apart(project.verify) else ["verify after the run is not ok"]
    except (NoEndError, RuntimeError) as error:
        wrong.append(last_line(error))
    return [f"{change}: {what}" for what in wrong]


def settled(project: FlippedStore, kind: str, how: str, rng: random.Random) -> list[str]:
    """Damage an unused file of previous code, verify and run, undo the edit and run; return the problems."""
    change, wrong = "", list[str]()
    try:
        project.edit("??")
        apart(project.run)
        change = damage(rng.choice(_former(project, kind)), how, rng)
        apart(project.verify)
        for mark in ("??", "!"):
            project.edit(mark)
            wrong += [] if apart(project.run)["texts"] == project.expected(mark) else [f"{mark}: wrong outputs"]
            wrong += [] if apart(project.verify) else [f"{mark}: verify after the run is not ok"]
    except (NoEndError, RuntimeError) as error:
        wrong.append(last_line(error))
    return [f"{change}: {what}" for what in wrong]


def _former(project: FlippedStore, kind: str) -> list[Path]:
    """Segments without a present task, or blobs with a text of previous code."""
    if kind == "blob":
        return [path for path in project.files(kind) if b"!" in path.read_bytes()]
    keys = [key.encode() for key in apart(project.keys)]
    return [path for path in project.files(kind) if not any(key in path.read_bytes() for key in keys)]


def built(folder: Path, kind: str) -> FlippedStore:
    """Finished store that holds files of a kind, with every cache written and valid."""
    project = FlippedStore(folder, ("ab", "cd", "bad") if kind == "failure" else ("ab", "cd")).write()
    apart(project.run)
    apart(project.fill_caches)
    return project
