"""1e: disks that are full, without inodes or read-only. One clear sentence; finished tasks are kept and the next run is right."""

from __future__ import annotations

import contextlib
import importlib
import os
import resource
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.reliability import toy
from benchmarks.reliability.rows import Plan, Row, skipped
from runner import Graph
from tests.helpers.flipped_stores import FlippedStore, apart

SIZES_KIB = (200, 6000)
"""the smallest disk holds little more than the store's folders, the largest nearly all of it"""
LARGE = "64m"
FILE_LIMIT = 20_000
WORDS = ("no space left", "quota", "read-only", "file too large", "cannot be written")


STAGE = '''"""word -> the same, many times"""

from __future__ import annotations

from toy.log import note
from toy.values import Word

TIMES = 20_000


def run(word: Word) -> Word:
    note("large", word.name)
    return Word(word.name, word.text * TIMES)
'''
TIMES = 20_000


class LargeStore(FlippedStore):
    """Store with outputs of 40 kB, so that the disk is full during a write and has a little space again afterwards."""

    def write(self) -> LargeStore:
        """Write the project with an additional stage."""
        super().write()
        (self.code / "toy" / "large.py").write_text(STAGE)
        return self

    def more(self, g: Graph, word: Any) -> tuple[Any, ...]:
        """One shard a word, and a list of them."""
        large, pair = (importlib.import_module(f"toy.{name}") for name in ("large", "pair"))
        first = g.pick(g.named("halves").add(pair.run, word=g.add(large.run, word=word)), lambda both: both.left)
        return (g.named("begun").add(importlib.import_module("toy.join").run, words=g.collect(first)),)

    def expected(self, mark: str = "!") -> dict[str, list[str]]:
        """The texts that a right run ends with."""
        return super().expected(mark) | {"begun": [" ".join(word[0] for word in self.words)]}

    @property
    def tasks(self) -> int:
        """Tasks of the graph."""
        return super().tasks + 2 * len(self.words) + 1


def rows(plan: Plan) -> list[Row]:
    """Run on a file system of our own where this process may mount one, else with a limit of the file size."""
    reason = cannot_mount(plan.place("probe"))
    if reason:
        return [skipped("full disk, no inodes, read-only store, on a small file system", reason), _limited(plan)]
    count, (least, most) = plan.times(40, 5), SIZES_KIB
    full = Row(f"full disk of {least} to {most} KiB: one sentence, then more space")
    for n in range(count):
        full.count(_small(plan, f"size={least + (most - least) * n // count}k", f"size={LARGE}", 2 * (n % 2)))
    inodes = Row("no inodes: one sentence, then more of them")
    inodes.count(_small(plan, f"size={LARGE},nr_inodes=150", f"size={LARGE},nr_inodes=0", 2))
    return [full, inodes, _cached(plan), _read_only(plan), _limited(plan)]


def cannot_mount(folder: Path) -> str:
    """Return the reason why no file system can be mounted; '' where it can."""
    if os.geteuid():
        return "mounting a file system needs root"
    try:
        with mounted(folder, "size=1m"):
            return ""
    except (OSError, subprocess.CalledProcessError) as error:
        return f"this process may not mount a file system ({error})"


@contextlib.contextmanager
def mounted(folder: Path, options: str) -> Iterator[None]:
    """A file system in memory."""
    folder.mkdir(parents=True, exist_ok=True)
    _mount("-t", "tmpfs", "-o", options, "tmpfs", str(folder))
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


def remount(folder: Path, options: str) -> None:
    """The same file system with other options."""
    _mount("-o", f"remount,{options}", str(folder))


def _mount(*words: str) -> None:
    subprocess.run(["mount", *words], check=True, capture_output=True)


def _sentence(ended: toy.Ended, needed: bool) -> list[str]:
    """Return the faults of a run that ended on a bad disk."""
    if ended.code == 0:
        return ["the run went well although it could not be"] if needed else []
    message = [ended.stderr] if ended.code == 3 else ended.report.get("failures", [])
    if "Traceback" in ended.stderr or not message:
        return [f"exit {ended.code}: {(ended.stderr or 'no message').splitlines()[-1]}"]
    odd = [line for line in message if "\n" in line.strip() or not any(word in line.lower() for word in WORDS)]
    return [f"exit {ended.code}, unclear: {odd[0]}"] if odd else []


def _small(plan: Plan, options: str, more: str, jobs: int) -> list[str]:
    project = LargeStore(plan.place(options), toy.WIDE).write()
    with mounted(project.store, options):
        wrong = _sentence(toy.run(project, jobs), False)
        remount(project.store, more)
        wrong += toy.wrong_later(project, set())
        wrong += [] if apart(project.verify) else ["verify is not ok"]
    return [f"{options}, jobs {jobs}: {what}" for what in wrong]


def _cached(plan: Plan) -> Row:
    row = Row("a finished store on a full disk, nothing to do")
    project = FlippedStore(plan.place("cached"), toy.WIDE).write()
    with mounted(project.store, "size=8m"):
        wrong = toy.wrong_end(project, toy.run(project))
        with contextlib.suppress(OSError), (project.store / "filler").open("wb", buffering=0) as filler:
            while True:
                filler.write(bytes(4096))
        ended = toy.run(project)
        wrong += _sentence(ended, False)
        (project.store / "filler").unlink()
        wrong += toy.wrong_later(project, set())
    row.count(wrong)
    if not wrong and ended.code:
        row.held, row.design, row.reason = 0, 1, "a run writes into its store before it begins, so that it fails early and clearly"
    return row


def _read_only(plan: Plan) -> Row:
    row = Row("read-only store: one sentence, then writable again")
    project = FlippedStore(plan.place("read-only"), toy.WIDE).write()
    with mounted(project.store, f"size={LARGE}"):
        wrong = toy.wrong_end(project, toy.run(project))
        remount(project.store, "ro")
        wrong += _sentence(toy.run(project), True)
        remount(project.store, "rw")
        wrong += toy.wrong_later(project, set())
    row.count(wrong)
    return row


def _limited(plan: Plan) -> Row:
    """Files may have 20 kB: blobs fit, caches do not."""
    row = Row(f"no file may be larger than {FILE_LIMIT} bytes: one sentence, then without the limit")
    project = FlippedStore(plan.place("limited"), toy.WIDE).write()
    hard = resource.getrlimit(resource.RLIMIT_FSIZE)[1]
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_LIMIT, hard))
    try:
        wrong = _sentence(toy.run(project), False)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    row.count(wrong + toy.wrong_later(project, set()))
    return row
