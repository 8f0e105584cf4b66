"""Reasons, plans, progress events, and the final report of a run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

Why = Literal["first run", "input changed", "parameter changed", "code changed", "schema changed", "library version changed",
              "threads changed", "machine changed", "output lost", "output damaged", "output dropped",
              "forced", "upstream pending"]
Result = Literal["ran", "cached", "failed", "blocked", "deferred"]


@dataclass(frozen=True)
class Reason:
    """Reason of a task's run: one entry of a closed list, and the input, parameter or definition concerned."""

    why: Why
    detail: str = ""

    def __str__(self) -> str:
        return f"{self.why}: {self.detail}" if self.detail else self.why


@dataclass(frozen=True)
class TaskPlan:
    """Planned action for one shard of a stage; `key` is '' while an input is not computed yet."""

    stage: str
    shard: str
    status: Literal["cached", "run", "pending", "blocked"]
    reason: Reason
    """reason to run; for a cached task, the reason of its last run"""
    key: str = ""
    output: str = ""


@dataclass(frozen=True)
class Failure:
    """A shard that failed."""

    stage: str
    shard: str
    message: str
    key: str = ""


@dataclass
class RunReport:
    """Result of a run.

    `outputs` maps every handle of the target, and every published value on the way, to its (shard, artifact digest) pairs.
    """

    target: str
    ran: dict[str, int] = field(default_factory=dict)
    cached: dict[str, int] = field(default_factory=dict)
    failed: dict[str, int] = field(default_factory=dict)
    blocked: dict[str, int] = field(default_factory=dict)
    deferred: dict[str, int] = field(default_factory=dict)
    """tasks that a run with a time limit deferred to the next run"""
    failures: list[Failure] = field(default_factory=list)
    outputs: dict[str, list[tuple[str, str]]] = field(default_factory=dict)
    stale: list[str] = field(default_factory=list)
    used: dict[str, dict[str, str]] = field(default_factory=dict)
    """stage -> shard -> key of every task that ran or was cached"""
    cpu_s: dict[tuple[str, str], float] = field(default_factory=dict)
    """CPU seconds of every finished (stage, shard), also of those that an earlier run computed"""
    peak_mib: dict[tuple[str, str], float] = field(default_factory=dict)
    """peak memory of the process during the task, MiB"""
    seconds: float = 0.0

    @property
    def ok(self) -> bool:
        """True when nothing failed."""
        return not self.failures


class Observer(Protocol):
    """Receives the events of a run, in the thread of the scheduler; it must not block."""

    def begun(self, report: RunReport) -> None:
        """A run begins, and fills its report while it goes on."""

    def planned(self, stage: str, shard: str) -> None:
        """A task is known; later shards become known while earlier ones run."""

    def started(self, stage: str, shard: str, reason: Reason) -> None:
        """A worker has started the task."""

    def cached(self, stage: str, count: int) -> None:
        """Tasks of a stage were found in the store; they are neither planned nor finished."""

    def progress(self, stage: str, shard: str, done: int, total: int) -> None:
        """The stage reported its progress."""

    def finished(self, stage: str, shard: str, result: Result, wall_s: float, cpu_s: float, message: str) -> None:
        """The task is over; `message` gives the reason of a failure, '' otherwise."""


def increment(table: dict[str, int], stage: str) -> None:
    """Add one to a stage's count."""
    table[stage] = table.get(stage, 0) + 1


class SilentObserver:
    """Observer that ignores every event."""

    def planned(self, *_: Any) -> None:
        """Ignore the event."""

    begun = started = progress = finished = cached = planned
