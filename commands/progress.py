"""Progress of a run: a bar per stage on a terminal, a line per finished task elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from threading import Event, Thread
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from runner import Reason, RunReport

BEAT_S = 30.0
"""seconds between two lines about a running task"""


class ProgressObserver(Protocol):
    """Observer that is a context manager."""

    def __enter__(self) -> ProgressObserver: ...
    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None: ...
    def begun(self, report: RunReport) -> None:
        """A run begins."""

    def planned(self, stage: str, shard: str) -> None:
        """A task is known."""

    def started(self, stage: str, shard: str, reason: Reason) -> None:
        """A worker has started the task."""

    def cached(self, stage: str, count: int) -> None:
        """Tasks of a stage were found in the store."""

    def progress(self, stage: str, shard: str, done: int, total: int) -> None:
        """The stage reported its progress."""

    def finished(self, stage: str, shard: str, result: str, wall_s: float, cpu_s: float, message: str) -> None:
        """The task is over."""


def observer(quiet: bool) -> ProgressObserver:
    """Bars on a terminal, plain lines elsewhere; both write to stderr."""
    console = Console(stderr=True)
    return Bars(console) if console.is_terminal and not quiet else Lines(quiet)


class Bars:
    """One bar per stage: finished tasks of those known, rate, time left."""

    def __init__(self, console: Console) -> None:
        columns = (TextColumn("{task.description:<24}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[note]}"),
                   TimeRemainingColumn(compact=True))  # fmt: skip
        self._bars = Progress(*columns, console=console)
        self._ids: dict[str, TaskID] = {}
        self._known: dict[str, int] = {}
        self._began: dict[str, float] = {}
        self._worked: dict[str, int] = {}
        self._part: dict[tuple[str, str], float] = {}

    def __enter__(self) -> Self:
        self._bars.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._bars.stop()

    def begun(self, report: RunReport) -> None:
        """Show nothing yet."""

    def planned(self, stage: str, shard: str) -> None:
        """Add one task to the stage."""
        self._add(stage, 1)

    def cached(self, stage: str, count: int) -> None:
        """Add finished tasks to the stage."""
        self._add(stage, count)
        self._bars.advance(self._ids[stage], count)

    def _add(self, stage: str, count: int) -> None:
        self._known[stage] = self._known.get(stage, 0) + count
        if stage not in self._ids:
            self._ids[stage] = self._bars.add_task(stage, total=1, note="")
        self._bars.update(self._ids[stage], total=self._known[stage])

    def started(self, stage: str, shard: str, reason: Reason) -> None:
        """Show the reason of the task."""
        self._began.setdefault(stage, time.monotonic())
        self._bars.update(self._ids[stage], note=escape(f"{shard}: {reason}"[:60]))

    def progress(self, stage: str, shard: str, done: int, total: int) -> None:
        """Advance the bar by the finished part of the task."""
        part, before = done / max(total, 1), self._part.get((stage, shard), 0.0)
        self._part[stage, shard] = part
        self._bars.advance(self._ids[stage], part - before)

    def finished(self, stage: str, shard: str, result: str, wall_s: float, cpu_s: float, message: str) -> None:
        """Complete the task."""
        bar = self._ids[stage]
        self._bars.advance(bar, 1 - self._part.pop((stage, shard), 0.0))
        if result == "ran":
            self._worked[stage] = self._worked.get(stage, 0) + 1
            rate = self._worked[stage] / max(time.monotonic() - self._began[stage], 1e-3)
            self._bars.update(bar, note=f"{rate:.2f}/s" if rate >= 0.1 else f"{1 / rate:.0f} s each")
        if result == "failed":
            self._bars.console.print(f"[red]failed[/] {escape(f'{stage} {shard}: {message}')}", highlight=False)


@dataclass
class _Task:
    """Start time of a running task, and its finished part if the stage reports it."""

    began: float
    part: float | None = None


class Lines:
    """A plain line for every task that ran or failed.

    A task without shards is announced at its start. A task that runs for long is reported every BEAT_S seconds.
    """

    def __init__(self, quiet: bool, now: Callable[[], float] = time.monotonic) -> None:
        self._quiet, self._now = quiet, now
        self._left = 0
        self._running: dict[tuple[str, str], _Task] = {}
        self._over = Event()
        self._beating = Thread(target=self._beat, daemon=True)

    def __enter__(self) -> Self:
        if not self._quiet:
            self._beating.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._over.set()
        sys.stderr.flush()

    def begun(self, report: RunReport) -> None:
        """Print nothing."""

    def planned(self, stage: str, shard: str) -> None:
        """Count the task."""
        self._left += 1

    def cached(self, stage: str, count: int) -> None:
        """Print nothing."""

    def started(self, stage: str, shard: str, reason: Reason) -> None:
        """Record the start; print a line for the only task of a stage."""
        self._running[stage, shard] = _Task(self._now())
        if not shard:
            self._say(stage, shard, f"started ({reason})")

    def progress(self, stage: str, shard: str, done: int, total: int) -> None:
        """Record the finished part."""
        if (stage, shard) in self._running:
            self._running[stage, shard].part = done / max(total, 1)

    def finished(self, stage: str, shard: str, result: str, wall_s: float, cpu_s: float, message: str) -> None:
        """Print a line, unless the task was cached."""
        self._left -= 1
        self._running.pop((stage, shard), None)
        if result in ("ran", "failed"):
            note = f"{wall_s:6.1f} s" if result == "ran" else f"failed: {message}"
            self._say(stage, shard, f"{note}  ({self._left} known tasks left)")

    def report(self) -> None:
        """Print a line for each task that has run for BEAT_S seconds or longer."""
        for (stage, shard), task in list(self._running.items()):
            seconds = self._now() - task.began
            if seconds >= BEAT_S:
                part = "" if task.part is None else f"{task.part:6.1%}, "
                self._say(stage, shard, f"{part}running for {seconds:.0f} s")

    def _beat(self) -> None:
        while not self._over.wait(BEAT_S):
            self.report()

    def _say(self, stage: str, shard: str, note: str) -> None:
        if not self._quiet:
            sys.stderr.write(f"{stage:<22} {shard:<12} {note}\n")
            sys.stderr.flush()
