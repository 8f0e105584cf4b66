"""Which targets read the settings of a stage: a setting that the target does not read is refused."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from afford.extraction.sources.discover import Source
from commands.compare import Names, built
from commands.errors import UsageError
from commands.origin import origin
from commands.targets import ALL, TARGETS, build
from maps import settings as settings_of_systems
from maps.settings import SYSTEMS, Origin, Settings
from runner import Graph

COPYING = (dataclasses.__name__, settings_of_systems.__name__)
"""modules that copy settings with a change, which is no reading"""


def watched(chosen: Settings) -> tuple[Settings, set[str]]:
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


def laid_out(target: str, source: Path | None, clips: tuple[str, ...], sets: Iterable[str], columns: Mapping[str, Settings],
             digest: Callable[[Path], str]) -> tuple[Graph, Names, Origin, Source | None]:  # fmt: skip
    """The graph of a target with these settings, the names of its stages in a comparison, and what it is made of. UsageError when
    one of them does not fit, also for a `--set` that the target does not read.
    """
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
            homes = [name for name, _, used in _every_target() if stage in used]
            other = [name for name in homes if name not in (target, ALL)]
            said = f"; it belongs to {', '.join(other)}" if other else ""
            with_source = " with this source" if target in homes else ""
            raise UsageError(f"--set {word}: {target} has no use for {stage}{with_source}{said}")


def _every_target() -> Iterator[tuple[str, Graph, set[str]]]:
    """Every target as it is without a source: name, graph, the stages whose parameters it reads."""
    for target in TARGETS:
        chosen, read = watched(Settings())
        place: Origin = origin(target, None, chosen, _unread)[0]
        yield target, build(target, place, chosen), read


def _unread(path: Path) -> str:
    """What is in files does not matter for the shape of a graph."""
    return ""
