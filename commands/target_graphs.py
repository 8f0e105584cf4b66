"""Graphs of targets: the stages that each target has, and the settings that it reads.

A stage is named by its name in the graph, or by that of its function, in the first target that has it. A `--set` that the target
does not read is refused.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from afford.extraction.sources.discover import Source
from commands.compare import Names, build_columns
from commands.errors import UsageError, unknown
from commands.origin import origin
from commands.targets import ALL, TARGETS, USUAL, build
from maps import settings as settings_of_systems
from maps.settings import SYSTEMS, Origin, Settings
from runner import Graph

if TYPE_CHECKING:
    from runner.graph import Node


MANY = 4
"""maximum number of names listed for one stage"""


def function_name(node: Node) -> str:
    """Name of a stage's function, which is that of its file."""
    return str(node.value.__module__.rpartition(".")[2])


def names_in_graph(stage: str, graph: Graph) -> list[str]:
    """Names in a graph for the user's word `stage`: the stage of this name, or all stages of this function."""
    word = stage.replace("-", "_")
    nodes = graph.stages()
    return [node.name for node in nodes if node.name == word] or [node.name for node in nodes if function_name(node) == word]


def resolve_target(target: str | None, stage: str | None = None) -> str:
    """Target of this name; without a name, the first target that has the stage.

    UsageError for an unknown name.
    """
    if target is None:
        return first_target_with(stage) if stage else USUAL
    word = target.replace("_", "-")
    if word not in TARGETS:
        raise unknown("target", target, TARGETS)
    return word


def first_target_with(stage: str) -> str:
    """First target that has a stage of this name, else the first that has its function.

    UsageError with the nearest names when no target has it.
    """
    graphs = [(name, graph) for name, graph, _ in _default_graphs() if name != ALL]
    word = stage.replace("-", "_")
    by_name = [name for name, graph in graphs if any(node.name == word for node in graph.stages())]
    found = by_name or [name for name, graph in graphs if names_in_graph(stage, graph)]
    if not found:
        nodes = [node for _, graph in graphs for node in graph.stages()]
        raise unknown("stage", stage, {node.name for node in nodes} | {function_name(node) for node in nodes})
    return found[0]


def resolve_stages(stages: Iterable[str], target: str, graph: Graph) -> list[str]:
    """Names of these stages in the graph of the target.

    UsageError for a stage that it lacks, with the targets that have it.
    """
    out: list[str] = []
    for stage in stages:
        found = names_in_graph(stage, graph)
        if not found:
            raise _elsewhere(stage, target, graph)
        out += found
    return list(dict.fromkeys(out))


def _elsewhere(stage: str, target: str, graph: Graph) -> UsageError:
    word = stage.replace("-", "_")
    homes = [_home(name, word, other) for name, other, _ in _default_graphs() if name != ALL]
    if any(homes):
        return UsageError(f"{target} has no stage {word!r}; it belongs to {', '.join(one for one in homes if one)}")
    return unknown("stage", stage, [node.name for node in graph.stages()])


def _home(target: str, stage: str, graph: Graph) -> str:
    """Target with the stage, and its names there if they differ; '' for a target without the stage."""
    names = names_in_graph(stage, graph)
    if not names or stage in names:
        return target if names else ""
    return f"{target} (as {', '.join(names[:MANY])}{' ...' if len(names) > MANY else ''})"


COPYING = (dataclasses.__name__, settings_of_systems.__name__)
"""modules that copy settings with a change, which does not count as a read"""


def track_reads(chosen: Settings) -> tuple[Settings, set[str]]:
    """Copy settings, with a set that collects the stages whose parameters are read."""
    read: set[str] = set()
    return dataclasses.replace(chosen, **{system: _watching(getattr(chosen, system), read) for system in SYSTEMS}), read


def _watching(params: Any, read: set[str]) -> Any:
    """Parameters of one system that record each read."""

    class Watched(type(params)):  # type: ignore[misc]  # base class known only at run time
        def __getattribute__(self, name: str) -> Any:
            if sys._getframe(1).f_globals["__name__"] not in COPYING:
                read.add(name)
            return super().__getattribute__(name)

    return Watched(**{field.name: getattr(params, field.name) for field in dataclasses.fields(params)})


def graph_of_request(target: str, source: Path | None, clips: tuple[str, ...], sets: Iterable[str], columns: Mapping[str, Settings],
             digest: Callable[[Path], str]) -> tuple[Graph, Names, Origin, Source | None]:  # fmt: skip
    """Graph of a target with these settings, the names of its stages in a comparison, its origin and source.

    UsageError when one of them does not fit, also for a `--set` that the target does not read.
    """
    watching = {name: track_reads(column) for name, column in columns.items()}
    seen = {name: settings for name, (settings, _) in watching.items()}
    place, found = origin(target, source, next(iter(seen.values())), digest, clips)
    graph, names = build_columns(target, place, seen)
    check_sets(sets, target, {stage for _, read in watching.values() for stage in read})
    return graph, names, place, found


def check_sets(sets: Iterable[str], target: str, read: set[str]) -> None:
    """Raise UsageError for a `--set` of a stage whose parameters the target's graph has not read."""
    for word in sets:
        stage = word.partition(".")[0].replace("-", "_")
        if stage not in read:
            homes = [name for name, _, used in _default_graphs() if stage in used]
            other = [name for name in homes if name not in (target, ALL)]
            hint = f"; it belongs to {', '.join(other)}" if other else ""
            with_source = " with this source" if target in homes else ""
            raise UsageError(f"--set {word}: {target} does not use {stage}{with_source}{hint}")


def _default_graphs() -> Iterator[tuple[str, Graph, set[str]]]:
    """Yield name, graph and read stages of every target, as built without a source."""
    for target in TARGETS:
        chosen, read = track_reads(Settings())
        place = origin(target, None, chosen, lambda path: "")[0]  # file contents do not affect the shape of a graph
        yield target, build(target, place, chosen), read
