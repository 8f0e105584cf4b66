"""Words for stages: a stage goes by its name on a map, or by that of its function, in the first target that has it."""

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
"""names of one stage that are listed"""


def function_name(node: Node) -> str:
    """The name of a stage's function, which is that of its file."""
    return str(node.value.__module__.rpartition(".")[2])


def names_in_graph(stage: str, graph: Graph) -> list[str]:
    """Names in a graph of what a user calls `stage`: the one stage of this name, or all of this function."""
    word = stage.replace("-", "_")
    nodes = graph.stages()
    return [node.name for node in nodes if node.name == word] or [node.name for node in nodes if function_name(node) == word]


def resolve_target(target: str | None, stage: str | None = None) -> str:
    """The target that is asked for; where none is, the first one that has the stage. UsageError when there is no such thing."""
    if target is None:
        return first_target_with(stage) if stage else USUAL
    word = target.replace("_", "-")
    if word not in TARGETS:
        raise unknown("target", target, TARGETS)
    return word


def first_target_with(stage: str) -> str:
    """The first target that has a stage of this name; of no name, the first that has its function. UsageError, with the nearest
    names, when none has it.
    """
    graphs = list(_graphs())
    word = stage.replace("-", "_")
    by_name = [name for name, graph in graphs if any(node.name == word for node in graph.stages())]
    found = by_name or [name for name, graph in graphs if names_in_graph(stage, graph)]
    if not found:
        nodes = [node for _, graph in graphs for node in graph.stages()]
        raise unknown("stage", stage, {node.name for node in nodes} | {function_name(node) for node in nodes})
    return found[0]


def resolve_stages(stages: Iterable[str], target: str, graph: Graph) -> list[str]:
    """Names of these stages in the graph of the target. UsageError for one that it does not have; it says which targets do."""
    out: list[str] = []
    for stage in stages:
        found = names_in_graph(stage, graph)
        if not found:
            raise _elsewhere(stage, target, graph)
        out += found
    return list(dict.fromkeys(out))


def _elsewhere(stage: str, target: str, graph: Graph) -> UsageError:
    word = stage.replace("-", "_")
    homes = [_home(name, word, graph) for name, graph in _graphs()]
    if any(homes):
        return UsageError(f"stage {word!r} is none of {target}; it belongs to {', '.join(one for one in homes if one)}")
    return unknown("stage", stage, [node.name for node in graph.stages()])


def _home(target: str, stage: str, graph: Graph) -> str:
    """A target that has the stage, with the names that it goes under there where these are others; '' for one that has it not."""
    names = names_in_graph(stage, graph)
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


COPYING = (dataclasses.__name__, settings_of_systems.__name__)
"""modules that copy settings with a change, which is no reading"""


def track_reads(chosen: Settings) -> tuple[Settings, set[str]]:
    """The same settings, and the stages whose parameters are read from them, as it fills."""
    read: set[str] = set()
    return dataclasses.replace(chosen, **{system: _watching(getattr(chosen, system), read) for system in SYSTEMS}), read


def _watching(params: Any, read: set[str]) -> Any:
    """The parameters of one system, which note what is read of them."""

    class Watched(type(params)):  # type: ignore[misc]  # a class that is known when it runs
        def __getattribute__(self, name: str) -> Any:
            if sys._getframe(1).f_globals["__name__"] not in COPYING:
                read.add(name)
            return super().__getattribute__(name)

    return Watched(**{field.name: getattr(params, field.name) for field in dataclasses.fields(params)})


def graph_of_request(target: str, source: Path | None, clips: tuple[str, ...], sets: Iterable[str], columns: Mapping[str, Settings],
             digest: Callable[[Path], str]) -> tuple[Graph, Names, Origin, Source | None]:  # fmt: skip
    """The graph of a target with these settings, the names of its stages in a comparison, and what it is made of. UsageError when
    one of them does not fit, also for a `--set` that the target does not read.
    """
    watching = {name: track_reads(column) for name, column in columns.items()}
    seen = {name: settings for name, (settings, _) in watching.items()}
    place, found = origin(target, source, next(iter(seen.values())), digest, clips)
    graph, names = build_columns(target, place, seen)
    check_sets(sets, target, {stage for _, read in watching.values() for stage in read})
    return graph, names, place, found


def check_sets(sets: Iterable[str], target: str, read: set[str]) -> None:
    """UsageError for a `--set` of a stage whose parameters nothing has read that was built for the target."""
    for word in sets:
        stage = word.partition(".")[0].replace("-", "_")
        if stage not in read:
            homes = [name for name, _, used in _every_target() if stage in used]
            other = [name for name in homes if name not in (target, ALL)]
            said = f"; it belongs to {', '.join(other)}" if other else ""
            with_source = " with this source" if target in homes else ""
            raise UsageError(f"--set {word}: {target} has no use for {stage}{with_source}{said}")


def _every_target() -> Iterator[tuple[str, Graph, set[str]]]:
    """Every target as it is without a source: name, graph, the stages whose parameters it reads."""
    for target in TARGETS:
        chosen, read = track_reads(Settings())
        place: Origin = origin(target, None, chosen, _no_digest)[0]
        yield target, build(target, place, chosen), read


def _no_digest(path: Path) -> str:
    """What is in files does not matter for the shape of a graph."""
    return ""
