"""Which targets a stage belongs to: for names that a target does not have, and for settings that it does not read."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from afford.extraction.sources.discover import Source
from commands.compare import Names, built
from commands.errors import UsageError, unknown
from commands.origin import origin
from maps.settings import Origin, Settings
from maps.weights import Weighed
from pipeline import TARGETS, build
from runner import Graph

MANY = 4
"""names of one stage that are listed"""


def watched(chosen: Settings) -> tuple[Settings, set[str]]:
    """The same settings, and the stages whose parameters are read from them, as it fills. To copy settings with a change is no
    reading."""
    read: set[str] = set()

    class Watched(Weighed):
        def __getattribute__(self, name: str) -> Any:
            if sys._getframe(1).f_globals["__name__"] != dataclasses.__name__:
                read.add(name)
            return super().__getattribute__(name)

    names = [field.name for field in dataclasses.fields(Weighed)]
    return Watched(**{name: getattr(chosen, name) for name in names if hasattr(chosen, name)}), read


def laid_out(target: str, source: Path | None, clips: tuple[str, ...], sets: Iterable[str], columns: Mapping[str, Settings],
             digest: Callable[[Path], str]) -> tuple[Graph, Names, Origin, Source | None]:  # fmt: skip
    """The graph of a target with these settings, the names of its stages in a comparison, and what it is made of. UsageError when
    one of them does not fit, also for a `--set` that the target does not read."""
    watching = {name: watched(column) for name, column in columns.items()}
    seen = {name: settings for name, (settings, _) in watching.items()}
    place, found = origin(target, source, next(iter(seen.values())), digest, clips)
    graph, names = built(target, place, seen)
    check_sets(sets, target, {stage for _, read in watching.values() for stage in read})
    return graph, names, place, found


def check_sets(sets: Iterable[str], target: str, read: set[str]) -> None:
    """UsageError for a `--set` of a stage whose parameters nothing has read that was built for the target."""
    for word in sets:
        stage = word.partition(".")[0].replace("-", "_")
        if stage not in read:
            homes = [name for name, _, used in _built() if stage in used]
            other = [name for name in homes if name != target]
            said = f"; it belongs to {', '.join(other)}" if other else ""
            with_source = " with this source" if target in homes else ""
            raise UsageError(f"--set {word}: {target} has no use for {stage}{with_source}{said}")


def check_stages(names: Iterable[str], target: str, graph: Graph) -> None:
    """UsageError for a stage that the graph of the target does not have; the message says which targets do."""
    valid = [node.name for node in graph.stages()]
    for stage in names:
        if stage not in valid:
            homes = [_home(name, stage, built) for name, built, _ in _built()]
            if any(homes):
                raise UsageError(f"stage {stage!r} is none of {target}; it belongs to {', '.join(home for home in homes if home)}")
            raise unknown("stage", stage, valid)


def _home(target: str, stage: str, graph: Graph) -> str:
    """A target that has the stage, with the names that it goes under there where these are others; '' for one that has it not."""
    names = [node.name for node in graph.stages() if stage in (node.name, node.value.__module__.rpartition(".")[2])]
    if not names or stage in names:
        return target if names else ""
    return f"{target} (as {', '.join(names[:MANY])}{' ...' if len(names) > MANY else ''})"


def _built() -> Iterator[tuple[str, Graph, set[str]]]:
    """Every target as it is without a source: name, graph, the stages whose parameters it reads."""
    for target in TARGETS:
        chosen, read = watched(Settings())
        place: Origin = origin(target, None, chosen, _unread)[0]
        yield target, build(target, place, chosen), read


def _unread(path: Path) -> str:
    """What is in files does not matter for the shape of a graph."""
    return ""
