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
from tests.flipped_stores import FlippedStore, apart

SIZES_KIB = (200, 4000)
"""the smallest disk holds little more than the store's folders, the largest nearly all of it"""
LARGE = "64m"
FILE_LIMIT = 20_000
WORDS = ("no space left", "quota", "read-only", "file too large", "cannot be written")


STAGE = '''"""word -> the same, with a large draft in its scratch folder meanwhile"""

from __future__ import annotations

import time
from typing import Any

from toy.log import note
from toy.values import Word


def run(word: Word, ctx: Any) -> Word:
    note("hungry", word.name)
    with (ctx.scratch / "draft").open("ab", buffering=0) as draft:
        for _ in range(100):
            draft.write(bytes(4096))
            time.sleep(0.0005)
    return word
'''


class HungryStore(FlippedStore):
    """With a stage that takes 400 kB for a moment, so that the disk may be full and have space again in one run."""

    def write(self) -> HungryStore:
        """With one stage more."""
        super().write()
        (self.code / "toy" / "hungry.py").write_text(STAGE)
        return self

    def more(self, g: Graph, word: Any) -> tuple[Any, ...]:
        """One shard a word."""
        return (g.add(importlib.import_module("toy.hungry").run, word=word),)

    def expected(self, mark: str = "!") -> dict[str, list[str]]:
        """The texts that a right run ends with."""
        return super().expected(mark) | {"hungry": list(self.words)}

    @property
    def tasks(self) -> int:
        """Tasks of the graph."""
        return super().tasks + len(self.words)


def rows(plan: Plan) -> list[Row]:
    """On a file system of our own where this process may mount one; else with a limit of a file's size."""
    reason = _cannot_mount(plan.place("probe"))
    if reason:
        return [skipped("full disk, no inodes, read-only store, on a small file system", reason), _limited(plan)]
    count, (least, most) = plan.times(40, 5), SIZES_KIB
    full = Row(f"full disk of {least} to {most} KiB: one sentence, then more space")
    for n in range(count):
        full.count(_small(plan, f"size={least + (most - least) * n // count}k", f"size={LARGE}"))
    inodes = Row("no inodes: one sentence, then more of them")
    inodes.count(_small(plan, f"size={LARGE},nr_inodes=150", f"size={LARGE},nr_inodes=0"))
    return [full, inodes, _cached(plan), _read_only(plan), _limited(plan)]


def _cannot_mount(folder: Path) -> str:
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
    """What is wrong with how a run on a bad disk ended."""
    if ended.code == 0:
        return ["the run went well although it could not be"] if needed else []
    said = [ended.said] if ended.code == 3 else ended.report.get("failures", [])
    if "Traceback" in ended.said or not said:
        return [f"exit {ended.code}: {(ended.said or 'nothing said').splitlines()[-1]}"]
    odd = [line for line in said if "\n" in line.strip() or not any(word in line.lower() for word in WORDS)]
    return [f"exit {ended.code}, unclear: {odd[0]}"] if odd else []


def _small(plan: Plan, options: str, more: str) -> list[str]:
    project = HungryStore(plan.place(options), toy.WIDE).write()
    with mounted(project.store, options):
        wrong = _sentence(toy.run(project), False)
        remount(project.store, more)
        wrong += toy.wrong_later(project, set())
        wrong += [] if apart(project.verify) else ["verify is not ok"]
    return [f"{options}: {what}" for what in wrong]


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
