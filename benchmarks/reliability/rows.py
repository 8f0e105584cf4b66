"""Rows of the page: what was tried, how often it held, how often it failed, and results by design."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

SHOWN = 5
"""failures of a row that are kept in words"""
LONGEST = 400
"""characters of each"""


@dataclass
class Row:
    """One test with its figures."""

    what: str
    tried: int = 0
    held: int = 0
    design: int = 0
    """by design: neither held nor failed"""
    reason: str = ""
    """why that is by design, or why the row was skipped"""
    figures: str = ""
    failures: list[str] = field(default_factory=list)

    @property
    def failed(self) -> int:
        """Number of tries in which the law did not hold."""
        return self.tried - self.held - self.design

    def count(self, wrong: list[str]) -> None:
        """One more try; `wrong` lists what did not hold."""
        self.tried += 1
        if not wrong:
            self.held += 1
        elif len(self.failures) < SHOWN:
            self.failures.append(" ".join("; ".join(wrong).split())[:LONGEST])

    def counted(self) -> dict[str, Any]:
        """Return the row as JSON values."""
        return asdict(self) | {"failed": self.failed}


@dataclass(frozen=True)
class Plan:
    """Extent of a part of the tests, and its folder."""

    folder: Path
    """empty; removed afterwards"""
    seed: int
    quick: bool
    fuzz: int
    """mutations of every reader"""

    def times(self, whole: int, quick: int) -> int:
        """Return the number of tries of a row."""
        return quick if self.quick else whole

    def place(self, name: str) -> Path:
        """A new folder."""
        folder = self.folder / name
        folder.mkdir(parents=True)
        return folder


Part = Callable[[Plan], list[Row]]


def skipped(what: str, reason: str) -> Row:
    """A row that could not be had on this machine."""
    return Row(what, reason=f"skipped: {reason}")
