"""Words for stages: a stage goes by its name on a map, or by that of its function, in the first target that has it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from commands.errors import UsageError, unknown
from commands.origin import origin
from commands.targets import ALL, TARGETS, USUAL, build
from maps.settings import Settings

if TYPE_CHECKING:
    from runner import Graph
    from runner.graph import Node

MANY = 4
"""names of one stage that are listed"""


def function(node: Node) -> str:
    """The name of a stage's function, which is that of its file."""
    return str(node.value.__module__.rpartition(".")[2])


def named(stage: str, graph: Graph) -> list[str]:
    """Names in a graph of what a user calls `stage`: the one stage of this name, or all of this function."""
    word = stage.replace("-", "_")
    nodes = graph.stages()
    return [node.name for node in nodes if node.name == word] or [node.name for node in nodes if function(node) == word]


def target_named(target: str | None, stage: str | None = None) -> str:
    """The target that is asked for; where none is, the first one that has the stage. UsageError when there is no such thing."""
    if target is None:
        return home(stage) if stage else USUAL
    word = target.replace("_", "-")
    if word not in TARGETS:
        raise unknown("target", target, TARGETS)
    return word


def home(stage: str) -> str:
    """The first target that has a stage of this name; of no name, the first that has its function. UsageError, with the nearest
    names, when none has it.
    """
    graphs = list(_graphs())
    word = stage.replace("-", "_")
    by_name = [name for name, graph in graphs if any(node.name == word for node in graph.stages())]
    found = by_name or [name for name, graph in graphs if named(stage, graph)]
    if not found:
        nodes = [node for _, graph in graphs for node in graph.stages()]
        raise unknown("stage", stage, {node.name for node in nodes} | {function(node) for node in nodes})
    return found[0]


def resolved(stages: Iterable[str], target: str, graph: Graph) -> list[str]:
    """Names of these stages in the graph of the target. UsageError for one that it does not have; it says which targets do."""
    out: list[str] = []
    for stage in stages:
        found = named(stage, graph)
        if not found:
            raise _elsewhere(stage, target, graph)
        out += found
    return list(dict.fromkeys(out))


def _elsewhere(stage: str, target: str, graph: Graph) -> UsageError:
    word = stage.replace("-", "_")
    homes = [_home(name, word, built) for name, built in _graphs()]
    if any(homes):
        return UsageError(f"stage {word!r} is none of {target}; it belongs to {', '.join(one for one in homes if one)}")
    return unknown("stage", stage, [node.name for node in graph.stages()])


def _home(target: str, stage: str, graph: Graph) -> str:
    """A target that has the stage, with the names that it goes under there where these are others; '' for one that has it not."""
    names = named(stage, graph)
    if not names or stage in names:
        return target if names else ""
    return f"{target} (as {', '.join(names[:MANY])}{' ...' if len(names) > MANY else ''})"


def _graphs() -> Iterator[tuple[str, Graph]]:
    """Every target that has stages of its own, as it is without a source."""
    chosen = Settings()
    for target in TARGETS:
        if target != ALL:
            yield target, build(target, origin(target, None, chosen, _unread)[0], chosen)


def _unread(path: Path) -> str:
    """What is in files does not matter for the shape of a graph."""
    return ""
