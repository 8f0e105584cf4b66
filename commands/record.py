"""`run --only STAGE --record`: the recording of one stage, made of what the stage has just made, and nothing else."""

from __future__ import annotations

from commands.part import RECORDS
from commands.progress import Shown
from commands.publish import publish_file
from maps.settings import Origin
from runner import Graph, Handle, Runner, RunReport


def record(runner: Runner, graph: Graph, stage: str, place: Origin, clips: tuple[str, ...], observer: Shown) -> tuple[
        RunReport | None, str]:  # fmt: skip
    """Run the recorder of a stage and publish what it makes: its report and the folder; no report, and why, where the stage has no
    recorder, or something else would have to run first."""
    recorder = next((node for node in graph.stages() if node.name == f"{RECORDS}{stage}"), None)
    if recorder is None:
        return None, f"{stage} has no recording of its own"
    handle = Handle(graph, recorder)
    waits = {plan.stage for plan in runner.plan(graph, handle, shards=clips or None) if plan.status != "cached"} - {recorder.name}
    if waits:
        return None, f"the recording of {stage} is not renewed, for {', '.join(sorted(waits))} would run first; run without --only"
    report = runner.run(graph, handle, shards=clips or None, observer=observer)
    folder = runner.place.store / "recordings" / place.name / stage
    for shard, digest in report.outputs[recorder.name]:
        publish_file(runner, digest, folder / f"{shard.rpartition('/')[2] or stage}.mcap")
    return report, str(folder)
