"""The targets that there are. The command line is passed them: which targets a project has is no matter of its verbs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from maps.settings import Origin, Settings
    from runner import Graph

TARGETS: dict[str, str] = {}
"""target -> where the lines of its graph stand, in the order of the help; empty until `use`"""
USUAL, ALL = "dataset", "all"
"""the target where none is named; the one that chains others, and has no stage of its own"""
_BUILD: list[Callable[..., Any]] = []


def use(targets: Mapping[str, str], build: Callable[[str, Origin, Settings], Graph]) -> None:
    """Take these targets, and the function that builds the graph of one."""
    TARGETS.clear()
    TARGETS.update(targets)
    _BUILD[:] = [build]


def build(target: str, origin: Origin, settings: Settings) -> Graph:
    """The graph of one target."""
    graph: Graph = _BUILD[0](target, origin, settings)
    return graph
