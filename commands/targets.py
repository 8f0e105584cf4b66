"""The targets of the project, which `pipeline.py` passes to the command line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from maps.settings import Origin, Settings
    from runner import Graph

TARGETS: dict[str, str] = {}
"""target -> "module:function" that builds its graph, in the order of the help; empty until `use`"""
USUAL, ALL = "dataset", "all"
"""default target; the target that chains others and has no stage of its own"""
_BUILD: list[Callable[..., Any]] = []


def use(targets: Mapping[str, str], build: Callable[[str, Origin, Settings], Graph]) -> None:
    """Set the targets, and the function that builds the graph of one."""
    TARGETS.clear()
    TARGETS.update(targets)
    _BUILD[:] = [build]


def build(target: str, origin: Origin, settings: Settings) -> Graph:
    """Build the graph of one target."""
    graph: Graph = _BUILD[0](target, origin, settings)
    return graph
