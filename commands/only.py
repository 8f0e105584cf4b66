"""Run one stage and its recorder on the last inputs: `run --only STAGE`. Missing inputs are computed first."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from commands.outputs import RECORDS
from commands.publish import publish_file
from maps.settings import Origin
from runner import Graph, Handle, Runner, RunReport, TaskPlan
from runner.graph import Node
from runner.report import Observer

RECORDINGS = "recordings/"
"""place of published recordings"""
Unrecorded = dict[str, str]
"""stage -> reason why it is not recorded"""


def run_only(runner: Runner, graph: Graph, stages: Iterable[str], clips: tuple[str, ...], force: Iterable[str],
         observer: Observer) -> RunReport:  # fmt: skip
    """Run stages on the last inputs of each of their shards.

    A stage that never ran on this source runs with everything that it needs.
    """
    report = RunReport("")
    nodes = [_node(graph, stage) for stage in stages]
    seen = {node.name: shards_with_inputs(runner, graph, node, clips) for node in nodes}
    fresh = tuple(Handle(graph, node) for node in nodes if not seen[node.name])
    if fresh:
        add(report, runner.run(graph, fresh, shards=clips or None, force=force, observer=observer))
    for stage, shards in seen.items():
        if shards:
            add(report, runner.run(graph, Handle(graph, _node(graph, stage)), shards=shards, only=stage, force=force,
                                   observer=observer))  # fmt: skip
    return report


def plan_only(runner: Runner, graph: Graph, stages: Iterable[str], clips: tuple[str, ...], force: Iterable[str]) -> list[TaskPlan]:
    """Plan `run_only`, recorders included."""
    out: dict[tuple[str, str], TaskPlan] = {}
    for node in (_node(graph, stage) for stage in stages):
        alone = bool(shards_with_inputs(runner, graph, node, clips))
        wanted = [node, *recorders(graph, node)]
        plans = runner.plan(graph, tuple(Handle(graph, one) for one in wanted), shards=clips or None, force=force)
        needed = {one.name for one in wanted} if alone else {one.name for one in (*graph.upstream([node]), *wanted)}
        out |= {(one.stage, one.shard): one for one in plans if one.stage in needed}
    return list(out.values())


def shards_with_inputs(runner: Runner, graph: Graph, node: Node, clips: tuple[str, ...]) -> tuple[str, ...]:
    """Shards of this source on which the stage has run, with inputs of the same names.

    With `clips`, only shards of these clips. Where the plan does not name a shard, it is one of this source if it was computed from
    some of the files of the source.
    """
    plans = runner.plan(graph, Handle(graph, node), shards=clips or None)
    heads = {plan.shard.split("/")[0] for plan in plans if plan.stage == node.name}
    traces = {shard: runner.traces.get(key) for shard, key in runner.traces.shards(node.name).items()}
    mine = {shard for shard, trace in traces.items() if trace and trace.inputs.keys() == {name for name, _ in node.inputs}}
    found = [shard for shard in sorted(mine) if heads & {"*", shard.split("/")[0]} and
             (not clips or set(clips) & set(shard.split("/")))]  # fmt: skip
    unnamed = {shard: trace.output for shard in found
               if (trace := traces[shard]) and (not shard or shard.split("/")[0] not in heads)}  # fmt: skip
    files = source_leafs(runner, graph, node) if unnamed else frozenset[str]()
    origins = runner.leafs(unnamed.values()) if files else {}
    return tuple(shard for shard in found if shard not in unnamed or not files or files & origins[unnamed[shard]])


def source_leafs(runner: Runner, graph: Graph, node: Node) -> frozenset[str]:
    """Digests of the leafs with files, and of their parts, behind the shards of a stage and of those before it.

    None for a stage that no source is spread over.
    """
    axes = {axis for one in graph.upstream([node]) for axis in one.axes}
    behind = graph.upstream([graph.nodes[axis] for axis in sorted(axes)])
    whole = (runner.store.put_leaf(one.value) for one in behind if one.sort == "leaf")
    return frozenset(part for one in whole for part, found in runner.store.closure(one) if found and found.files)


def record(runner: Runner, graph: Graph, stages: Iterable[str], clips: tuple[str, ...], report: RunReport,
           observer: Observer) -> Unrecorded:  # fmt: skip
    """Record the outputs of `stages`, and add the runs to the report.

    Returns the stages that are not recorded, with the reason.
    """
    waiting: Unrecorded = {}
    for node in (_node(graph, stage) for stage in stages):
        found = recorders(graph, node)
        if not found and not _is_recording(graph, node):
            waiting[node.name] = f"{node.name} has no recording of its own"
        for recorder in found:
            waits = _waits(runner, graph, recorder, clips)
            if waits:
                names = ", ".join(sorted(waits))
                waiting[node.name] = (f"the recording of {node.name} is not updated, since {names} would run first; "
                                      "run without --only")
            else:
                more = runner.run(graph, Handle(graph, recorder), shards=clips or None, observer=observer)
                add(report, more, recorder.name)
    return waiting


def recorders(graph: Graph, node: Node) -> list[Node]:
    """Stage that records this one; else stages that read its output and whose output is a published recording."""
    own = [one for one in graph.stages() if one.name == RECORDS + node.name]
    return own or [one for one in graph.stages() if _is_recording(graph, one) and node in _sources(graph, one)]


def publish_recordings(runner: Runner, graph: Graph, stage: str, place: Origin, report: RunReport) -> Path | None:
    """Publish recordings of one stage that are otherwise only parts of the clips' recordings.

    Returns their own folder; None where there are none.
    """
    folder, recorder = runner.store.root / RECORDINGS / place.name / stage, RECORDS + stage
    if recorder not in report.outputs or _is_recording(graph, _node(graph, recorder)):
        return None
    for shard, digest in report.outputs[recorder]:
        publish_file(runner, digest, folder / f"{shard.rpartition('/')[2] or stage}.mcap")
    return folder


def add(report: RunReport, more: RunReport, alone: str | None = None) -> None:
    """Add the counts of another run to the report, of one stage `alone` if it is named.

    Stages that the report already counts are not counted again.
    """
    for mine, theirs in ((report.ran, more.ran), (report.cached, more.cached), (report.failed, more.failed)):
        mine |= {stage: count for stage, count in theirs.items() if alone in (None, stage) and stage not in report.ran}
    report.outputs |= {name: made for name, made in more.outputs.items() if alone in (None, name)}
    report.failures += more.failures
    report.stale += more.stale
    report.cpu_s |= more.cpu_s
    report.peak_mib |= more.peak_mib
    for stage, shards in more.used.items():
        report.used.setdefault(stage, {}).update(shards)
    report.seconds += more.seconds


def _waits(runner: Runner, graph: Graph, recorder: Node, clips: tuple[str, ...]) -> set[str]:
    """Other stages that would run before the recorder."""
    plans = runner.plan(graph, Handle(graph, recorder), shards=clips or None)
    return {plan.stage for plan in plans if plan.status != "cached"} - {recorder.name}


def _is_recording(graph: Graph, node: Node) -> bool:
    return any(one.node == node.id and one.place.startswith(RECORDINGS) for one in graph.published)


def _sources(graph: Graph, node: Node) -> Iterator[Node]:
    """Yield the stages whose outputs a stage reads, whole, in parts or collected."""
    for _, source in node.inputs:
        one = graph.nodes[source]
        if one.sort == "stage":
            yield one
        else:
            yield from _sources(graph, one)


def _node(graph: Graph, stage: str) -> Node:
    return next(node for node in graph.stages() if node.name == stage)
