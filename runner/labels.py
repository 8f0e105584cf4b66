"""Labels on a graph: which of its values people look for, and where; which hold figures, and what stages cost. They are in no key,
and the runner only keeps them: who shows a run reads them.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Published:
    """A value with a place of its own, see `Graph.publish`."""

    node: int
    place: str
    """path with {source} and {clip} in it"""
    name: str
    """in the summary of a run"""
    part: str = ""
    """which of several targets that are made together it belongs to"""


@dataclass(frozen=True)
class Measured:
    """A value with figures, see `Graph.measure`."""

    node: int
    file: str
    under: str
    part: str = ""


@dataclass(frozen=True)
class Cost:
    """What stages cost, see `Graph.cost`."""

    name: str
    stages: tuple[str, ...]
    measured: int
    per: str
    """figure of the measured value"""
    shards: str | None
    """stage whose shards count; None: all do"""
    scale: float
    each: bool
    rate: bool
    part: str = ""
