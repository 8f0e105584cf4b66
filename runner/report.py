"""What a run says: reasons, plans, events while it goes on, and the report at the end."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

Why = Literal["first run", "input changed", "parameter changed", "code changed", "schema changed", "library version changed",
              "threads changed", "machine changed", "output lost", "output damaged", "forced", "upstream pending"]
Result = Literal["ran", "cached", "failed", "blocked", "left"]


@dataclass(frozen=True)
class Reason:
    """Why a task runs, in one of a closed list of ways; `detail` says which input, parameter or definition."""

    why: Why
    detail: str = ""

    def __str__(self) -> str:
        return f"{self.why}: {self.detail}" if self.detail else self.why


@dataclass(frozen=True)
class TaskPlan:
    """What a run would do with one shard of a stage. `key` is '' while an input is still to be made."""

    stage: str
    shard: str
    status: Literal["cached", "run", "pending", "blocked"]
    reason: Reason
    """run, pending: why; cached: why it ran last"""
    key: str = ""
    output: str = ""


@dataclass(frozen=True)
class Failure:
    """One shard that failed, or that could not run because of one that did (`blocked`)."""

    stage: str
    shard: str
    message: str
    key: str = ""


@dataclass
class RunReport:
    """What a run did. `outputs` holds, for every handle of the target and for what is published on
    the way, its (shard, artifact digest) pairs.
    """

    target: str
    ran: dict[str, int] = field(default_factory=dict)
    cached: dict[str, int] = field(default_factory=dict)
    failed: dict[str, int] = field(default_factory=dict)
    blocked: dict[str, int] = field(default_factory=dict)
    left: dict[str, int] = field(default_factory=dict)
    """what a run with a limit has left for the next one"""
    failures: list[Failure] = field(default_factory=list)
    outputs: dict[str, list[tuple[str, str]]] = field(default_factory=dict)
    stale: list[str] = field(default_factory=list)
    cpu_s: dict[tuple[str, str], float] = field(default_factory=dict)
    """CPU seconds of every (stage, shard) that is done, also when it ran in an earlier run"""
    peak_mib: dict[tuple[str, str], float] = field(default_factory=dict)
    """the most memory that its process held while it ran, MiB"""
    seconds: float = 0.0

    @property
    def ok(self) -> bool:
        """True when nothing failed."""
        return not self.failures


class Observer(Protocol):
    """Told what goes on, from the scheduler's own thread; it must not block."""

    def planned(self, stage: str, shard: str) -> None:
        """A task is known (shards stream: later ones come while earlier ones run)."""

    def started(self, stage: str, shard: str, reason: Reason) -> None:
        """A worker has begun."""

    def progress(self, stage: str, shard: str, done: int, total: int) -> None:
        """The stage said how far it is."""

    def finished(self, stage: str, shard: str, result: Result, wall_s: float, cpu_s: float, message: str) -> None:
        """The task is over; `message` says why it failed, '' otherwise."""


def count(table: dict[str, int], stage: str) -> None:
    """One more."""
    table[stage] = table.get(stage, 0) + 1


class Silent:
    """An observer that does nothing."""

    def planned(self, *_: Any) -> None: ...
    def started(self, *_: Any) -> None: ...
    def progress(self, *_: Any) -> None: ...
    def finished(self, *_: Any) -> None: ...
