"""The verb `run`: run a target, and show its outputs, metrics and failures."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from afford.extraction.sources.discover import Source
from commands.compare import Names, publish_columns
from commands.errors import UsageError
from commands.memory import show_memory_warnings, stage_memory
from commands.only import publish_recordings, record, run_only
from commands.origin import NEEDED
from commands.outputs import Publisher, collect_metrics, partial_outputs, publish_outputs
from commands.progress import observer
from commands.session import EngineChoice, digester, open_runner
from commands.settings import columns
from commands.summary import Summary, show_inspect_hints, show_summary
from commands.target_graphs import graph_of_request, resolve_stages, resolve_target
from commands.warnings import show_warnings
from commands.weights import resolve_weights
from maps.settings import Origin
from runner import Failure, Graph, LostError, Observer, Runner, RunReport
from runner.history import RunLog

T = TypeVar("T")
DEFAULT_MINUTES = {"ablation": 75.0, "grasp-full": 75.0, "sor3d-ablation": 75.0}
"""default time limit of targets that take many hours; the next run resumes"""


@dataclass(frozen=True)
class Request:
    """Arguments of `run` and of related verbs."""

    target: str | None
    """None: the default, or the first target with the stage of `only`"""
    source: Path | None = None
    clips: tuple[str, ...] = ()
    sets: tuple[str, ...] = ()
    params: Path | None = None
    only: str | None = None
    force: tuple[str, ...] = ()
    jobs: int | None = None
    store: Path | None = None
    rehash: bool = False
    json: bool = False
    minutes: float | None = None
    replace: bool = False
    remote: str | None = None
    """URL of a store that several hosts share; None: AFFORD_REMOTE"""
    record: bool | None = None
    """with `only`: record the outputs of the stages; None: yes"""
    engine: str | None = None
    """inline, pool or ray"""
    address: str | None = None
    """Ray cluster; None: a private one"""


@dataclass
class ActiveRun:
    """A run in progress: its graph, and the places of its outputs."""

    request: Request
    runner: Runner
    graph: Graph
    names: Names
    """names of the stages of every column, in a comparison"""
    place: Origin
    source: Source | None
    stages: list[str]
    """stages of `only`; empty for a whole target"""
    shown: Observer
    waiting: dict[str, str]
    """stage of `only` -> reason why it is not recorded"""

    def report(self, target: str, force: Iterable[str] = (), limit_s: float | None = None) -> RunReport:
        """Run the target, or the stages of `only` with their recorders."""
        clips = self.request.clips
        if not self.stages:
            return self.runner.run(self.graph, target, shards=clips or None, force=force, limit_s=limit_s, observer=self.shown)
        report = run_only(self.runner, self.graph, self.stages, clips, force, self.shown)
        if self.request.record is not False:
            self.waiting = record(self.runner, self.graph, self.stages, clips, report, self.shown)
        return report

    def outputs(self, report: RunReport) -> tuple[dict[str, str], dict[str, float], list[str]]:
        """Publish the outputs; return their places, the metrics, and notes about both.

        In a comparison, the outputs of every column are published. gc is kept away in the meantime.
        """
        with self.runner.reading():
            return self._published(report)

    def _published(self, report: RunReport) -> tuple[dict[str, str], dict[str, float], list[str]]:
        why = partial_outputs(self.graph, report, self.request.clips, len(self.source.refused) if self.source else 0)
        to = Publisher(self.runner, why, self.request.replace, bool(report.deferred))
        if self.names and not self.stages:
            folder = self.runner.store.root / "reports" / f"{self.place.name}-compare"
            return *publish_columns(to, report, self.names, folder), to.notes
        out = publish_outputs(to, self.graph, report, self.place, not (self.request.clips or self.stages))
        for stage in self.stages:
            recordings = publish_recordings(self.runner, self.graph, stage, self.place, report)
            out |= {"recordings": str(recordings)} if recordings else {}
        return out, collect_metrics(to, self.graph, report), [*to.notes, *self.waiting.values()]


def run(request: Request) -> int:
    """Run the target.

    Returns 0 when all went well, 1 when a shard failed. UsageError when the request does not fit.
    """
    target = resolve_target(request.target, request.only)
    _check(request, target)
    chosen = columns(request.sets, request.params)
    placing = EngineChoice(request.engine, request.address)
    runner = open_runner(request.store, request.jobs, request.rehash, remote=request.remote, engine=placing)
    weighted = {name: resolve_weights(column, digester(runner), target) for name, column in chosen.items()}
    graph, names, place, source = graph_of_request(target, request.source, request.clips, request.sets, weighted, digester(runner))
    stages = resolve_stages([request.only] if request.only else [], target, graph)
    force = resolve_stages(request.force, target, graph)
    limit_s = time_limit_s(request, target)
    with observer(quiet=False) as shown, RunLog(runner.store.root, target, typed(request), shown, runner.jobs) as log:
        going = ActiveRun(request, runner, graph, names, place, source, stages, log, {})
        report, (outputs, metrics, notes) = run_and_publish(partial(going.report, target), going.outputs, force, limit_s)
        log.ended(report)
    _refused(report, source)
    summary = Summary(target, report.ran, report.cached, report.failed, outputs, metrics, round(report.seconds, 3),
                      None if limit_s is None else report.deferred, notes or None)
    memory = stage_memory(runner, graph, report)
    show_summary(summary, report, source, memory)
    show_memory_warnings(memory, report.ran)
    show_warnings(runner, report)
    show_inspect_hints(report, [stage for stage in stages if stage in going.waiting or not outputs])
    if request.json:
        sys.stdout.write(summary.printed())
    return 0 if report.ok else 1


def typed(request: Request) -> dict[str, Any]:
    """Arguments that differ from their defaults, for the history."""
    given = {field.name: getattr(request, field.name) for field in fields(request) if field.name not in ("target", "store", "json")}
    usual = {field.name: field.default for field in fields(request)}
    return {name: _plain(value) for name, value in given.items() if value != usual[name]}


def _plain(value: Any) -> Any:
    return str(value) if isinstance(value, Path) else list(value) if isinstance(value, tuple) else value


def _check(request: Request, target: str) -> None:
    """Raise UsageError for options that do not fit together."""
    if target in NEEDED and request.source is None:
        raise UsageError(f"run {target}: needs --source with {NEEDED[target]}")
    if request.record and not request.only:
        raise UsageError("--record: works only with --only STAGE; without --only, every stage is recorded anyway")
    if request.jobs is not None and request.jobs < 0:
        raise UsageError(f"--jobs {request.jobs}: expected 0 (all in this process) or more")


def time_limit_s(request: Request, target: str) -> float | None:
    """Time limit in seconds: as requested (`inf` for none), else the default of the target."""
    usual = None if request.only else DEFAULT_MINUTES.get(target)
    minutes = usual if request.minutes is None else request.minutes
    return None if minutes is None or math.isinf(minutes) else 60 * minutes


def run_and_publish(
    execute: Callable[..., RunReport], publish: Callable[[RunReport], T], force: list[str], limit_s: float | None,
) -> tuple[RunReport, T]:
    """Run and publish.

    A blob that was damaged between its check and its use has been moved aside. Its producer then runs again, within the
    remaining time.
    """
    report = execute(force=force, limit_s=limit_s)
    try:
        return report, publish(report)
    except LostError:
        report = execute(limit_s=None if limit_s is None else max(0.0, limit_s - report.seconds))
        return report, publish(report)


def _refused(report: RunReport, source: Source | None) -> None:
    """Count videos that the source refused as failures of the reader."""
    for refused in source.refused if source else ():
        stage = "mesh_read" if source and source.kind == "meshes" else "source_read"
        report.failures.append(Failure(stage, refused.video_id, refused.reason))
        report.failed[stage] = report.failed.get(stage, 0) + 1
