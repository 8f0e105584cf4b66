"""What a run shows while it goes on: a bar per stage on a terminal, a line per finished task elsewhere."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from runner import Reason


class Shown(Protocol):
    """An observer that is opened and closed."""

    def __enter__(self) -> Shown: ...
    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None: ...
    def planned(self, stage: str, shard: str) -> None: ...
    def started(self, stage: str, shard: str, reason: Reason) -> None: ...
    def progress(self, stage: str, shard: str, done: int, total: int) -> None: ...
    def finished(self, stage: str, shard: str, result: str, wall_s: float, cpu_s: float, message: str) -> None: ...


def observer(quiet: bool) -> Shown:
    """Bars on a terminal, plain lines elsewhere; everything goes to stderr."""
    console = Console(stderr=True)
    return Bars(console) if console.is_terminal and not quiet else Lines(quiet)


class Bars:
    """One bar per stage: tasks done of those known, rate, time left."""

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

    def planned(self, stage: str, shard: str) -> None:
        """One more task of the stage."""
        self._known[stage] = self._known.get(stage, 0) + 1
        if stage not in self._ids:
            self._ids[stage] = self._bars.add_task(stage, total=1, note="")
        self._bars.update(self._ids[stage], total=self._known[stage])

    def started(self, stage: str, shard: str, reason: Reason) -> None:
        """Say why it runs."""
        self._began.setdefault(stage, time.monotonic())
        self._bars.update(self._ids[stage], note=escape(f"{shard}: {reason}"[:60]))

    def progress(self, stage: str, shard: str, done: int, total: int) -> None:
        """Move the bar by the part of the task that is done."""
        part, before = done / max(total, 1), self._part.get((stage, shard), 0.0)
        self._part[stage, shard] = part
        self._bars.advance(self._ids[stage], part - before)

    def finished(self, stage: str, shard: str, result: str, wall_s: float, cpu_s: float, message: str) -> None:
        """One task less to do."""
        bar = self._ids[stage]
        self._bars.advance(bar, 1 - self._part.pop((stage, shard), 0.0))
        if result == "ran":
            self._worked[stage] = self._worked.get(stage, 0) + 1
            rate = self._worked[stage] / max(time.monotonic() - self._began[stage], 1e-3)
            self._bars.update(bar, note=f"{rate:.2f}/s" if rate >= 0.1 else f"{1 / rate:.0f} s each")
        if result == "failed":
            self._bars.console.print(f"[red]failed[/] {escape(f'{stage} {shard}: {message}')}", highlight=False)


class Lines:
    """A plain line for every task that ran or failed."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._left = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        sys.stderr.flush()

    def planned(self, stage: str, shard: str) -> None:
        """Count it."""
        self._left += 1

    def started(self, stage: str, shard: str, reason: Reason) -> None:
        """Nothing to say."""

    def progress(self, stage: str, shard: str, done: int, total: int) -> None:
        """Nothing to say."""

    def finished(self, stage: str, shard: str, result: str, wall_s: float, cpu_s: float, message: str) -> None:
        """One line, unless it was cached."""
        self._left -= 1
        if result in ("ran", "failed") and not self._quiet:
            note = f"{wall_s:6.1f} s" if result == "ran" else f"failed: {message}"
            sys.stderr.write(f"{stage:<22} {shard:<12} {note}  ({self._left} known tasks left)\n")
