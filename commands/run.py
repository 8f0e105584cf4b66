"""`run`: make a target, show where its outputs are, end with a table of failures if there are any."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from afford.extraction.sources.discover import Source
from commands.belongs import check_stages, laid_out
from commands.compare import Names, publish_columns
from commands.content import content
from commands.errors import UsageError, unknown
from commands.origin import NEEDED
from commands.part import RECORDS, Publisher, parts
from commands.progress import observer
from commands.publish import owned, publish, publish_files, retire
from commands.session import digester, open_runner
from commands.settings import columns
from commands.warnings import show_warnings
from commands.weights import weighed
from maps.settings import Origin
from maps.static_sets import REPORTS
from pipeline import TARGETS
from runner import Failure, LostError, Runner, RunReport
from schemas.grasp import LEVELS

T = TypeVar("T")
USUAL_MINUTES = {"grasp-full": 75.0, "sor3d-ablation": 75.0}
"""tables that take many hours: how long a run of them lasts where nothing is said; the next one goes on"""
CLIPS = ("clip_record", "object_record")
"""stages that record a clip, or an object"""
MANY = 200
"""metrics that are all shown; of more, those of groups and intervals stand in the report alone"""
PIPED_WIDTH = 1000
"""columns where no terminal says how many: nothing is cut"""
MANY_SHARDS = 8
"""artifacts of one stage that are listed"""
EXTRACTION = ("frame_decode", "mask_densify", "hand_inpaint", "object_completion", "affordance_intersect")
NEGATIVE = ("mesh_read", "mesh_texture", "object_views", "object_masks", "part_describe", "mask_score",
            "negative_affordance_projection")  # fmt: skip


@dataclass(frozen=True)
class Request:
    """What the user asked for."""

    target: str
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
    record: bool = False


@dataclass
class Summary:
    """The JSON object that `--json` prints as the last line."""

    target: str
    ran: dict[str, int] = field(default_factory=dict)
    cached: dict[str, int] = field(default_factory=dict)
    failed: dict[str, int] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    metrics: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0
    left: dict[str, int] | None = None
    """only of a run that ends after some time"""
    notes: list[str] | None = None
    """what was published under the name of a part, or not made, and why"""


def run(request: Request) -> int:
    """Make the target; 0 when all went well, 1 when a shard failed. UsageError when the request does not fit."""
    target = request.target.replace("_", "-")
    if target not in TARGETS:
        raise unknown("target", request.target, TARGETS)
    if target in NEEDED and request.source is None:
        raise UsageError(f"run {target}: expected --source with {NEEDED[target]}")
    if request.record and not request.only:
        raise UsageError("--record: expected --only STAGE with it; without, every stage is recorded as it is")
    if request.jobs is not None and request.jobs < 0:
        raise UsageError(f"--jobs {request.jobs}: expected 0 (all in this process) or more")
    chosen = columns(request.sets, request.params)
    runner = open_runner(request.store, request.jobs, request.rehash)
    weighted = {name: weighed(column, digester(runner)) for name, column in chosen.items()}
    graph, names, place, source = laid_out(target, request.source, request.clips, request.sets, weighted, digester(runner))
    only, force = request.only and request.only.replace("-", "_"), [name.replace("-", "_") for name in request.force]
    check_stages([*force, *([only] if only else [])], target, graph)
    limit_s = limited(request, target)
    with observer(quiet=False) as shown:
        ask = partial(runner.run, graph, target, shards=request.clips or None, only=only, observer=shown)

        def publisher(report: RunReport) -> Publisher:
            why = parts(graph, report, request.clips, len(source.refused) if source else 0)
            return Publisher(runner, why, request.replace, bool(report.left))

        every = not (request.clips or only)
        report, (outputs, metrics, notes) = made(
            ask, lambda report: _published(publisher(report), report, place, names, every), force, limit_s)
        if only and request.record:
            from commands.record import record  # of few runs

            more, where = record(runner, graph, only, place, request.clips, shown)
            notes += [where] if more is None else []
            if more is not None:
                outputs["recordings"] = where
                _add(report, more)
    _refused(report, source)
    summary = Summary(target, report.ran, report.cached, report.failed, outputs, metrics, round(report.seconds, 3),
                      None if limit_s is None else report.left, notes or None)
    _show(summary, report, source)
    show_warnings(runner, report)
    if only and not outputs:
        _where(report)
    if request.json:
        said = {name: value for name, value in vars(summary).items() if value is not None}
        sys.stdout.write(json.dumps(said, sort_keys=True) + "\n")
    return 0 if report.ok else 1


def _add(report: RunReport, more: RunReport) -> None:
    """Count what a second run did of which the first has not heard."""
    for mine, theirs in ((report.ran, more.ran), (report.cached, more.cached), (report.failed, more.failed)):
        mine |= {stage: count for stage, count in theirs.items() if stage.startswith(RECORDS)}
    report.failures += more.failures
    report.cpu_s |= more.cpu_s
    report.seconds += more.seconds


def limited(request: Request, target: str) -> float | None:
    """Seconds after which the run ends: as it was asked for, `inf` being none; else as is usual for the target."""
    usual = None if request.only else USUAL_MINUTES.get(target)
    minutes = usual if request.minutes is None else request.minutes
    return None if minutes is None or math.isinf(minutes) else 60 * minutes


def made(
    ask: Callable[..., RunReport], publish: Callable[[RunReport], T], force: list[str], limit_s: float | None,
) -> tuple[RunReport, T]:
    """The report of a run and what was published of it. A blob that was damaged between its check and its use has been set aside:
    what made it runs again, within what is left of the time."""
    report = ask(force=force, limit_s=limit_s)
    try:
        return report, publish(report)
    except LostError:
        report = ask(limit_s=None if limit_s is None else max(0.0, limit_s - report.seconds))
        return report, publish(report)


def _published(to: Publisher, report: RunReport, place: Origin, names: Names, every: bool) -> tuple[
        dict[str, str], dict[str, float], list[str]]:  # fmt: skip
    """Outputs under names that people can find, what was measured, and which outputs are parts; of a comparison, those of every
    column. Where `every` clip was asked for and none failed, recordings of clips that are no more go."""
    store = to.runner.place.store
    if names:
        return *publish_columns(to, report, names, store / "reports" / f"{place.name}-compare"), to.notes
    outputs = _publish(to, report, place)
    clips = {f"{shard.rpartition('/')[2]}.mcap": digest for stage in CLIPS for shard, digest in report.outputs.get(stage, ())}
    if clips:
        folder = store / "recordings" / place.name
        publish_files(to.runner, clips, folder)
        with owned(store, folder):
            retire(folder, set(clips), every and report.ok and not report.left)
    return outputs, _metrics(report, outputs), to.notes


def _publish(to: Publisher, report: RunReport, place: Origin) -> dict[str, str]:
    """Friendly names for the outputs of the target: data sets, recordings, reports, files of rendered clips."""
    runner, store = to.runner, to.runner.place.store
    out: dict[str, str] = {}
    for stage, made in report.outputs.items():
        for shard, digest in made:
            clip = shard.rpartition("/")[2]
            if stage in ("dataset_pack", "train_pack"):
                out["dataset"] = to.folder(stage, digest, store / "datasets" / place.name)
            elif stage == "benchmark_set":
                out["benchmark"] = to.folder(stage, digest, store / "benchmarks" / place.name)
            elif stage in CLIPS:
                out["recordings"] = str(store / "recordings" / place.name)
            elif stage.startswith("record_"):
                to.file(stage, digest, store / "recordings" / place.name / f"{stage.removeprefix('record_')}.mcap")
                out["recordings"] = str(store / "recordings" / place.name)
            elif stage in ("model_train.files", "pretrained_model_train.files"):
                out["model"] = to.folder(stage, digest, store / "models" / place.name)
            elif stage in ("extraction_report", "benchmark", "ablation_report", "negative_affordance_report", "grasp_report",
                           "sor3d_report"):
                out["report"] = to.folder(stage, digest, store / "reports" / place.name)
            elif stage == "motion_files":
                out["report"] = to.folder(stage, digest, store / "motions" / place.name)
            elif stage in REPORTS or stage == "static_report":
                out[stage] = to.folder(stage, digest, store / "reports" / place.name / stage)
            elif stage == "interaction_record":
                out["films"] = to.folder(stage, digest, store / "recordings" / place.name / "interactions")
            elif stage == "grasp_record":
                out["films"] = to.folder(stage, digest, store / "recordings" / place.name / "grasps")
            elif stage == "hand_imitation.files":
                out["prior"] = to.folder(stage, digest, store / "models" / f"{place.name}-prior")
            elif stage == "policies":
                out |= _policies(runner, digest, place)
            elif stage == "negative_affordance_files":
                publish(runner, digest, store / "negative" / place.name / clip)
                out["negative"] = str(store / "negative" / place.name)
            elif stage == "scene_render":
                inside = dict(runner.children(digest) or ())
                for part in ("files", "truth"):
                    publish(runner, inside[part], store / "scenes" / place.name / clip / part)
                out["scenes"] = str(store / "scenes" / place.name)
    return out


def _policies(runner: Runner, digest: str, place: Origin) -> dict[str, str]:
    """Row -> folder of each policy that is finished; the parts are named <number>_<row>_<seed>.files."""
    found = {name.partition("_")[2].rpartition("_")[0]: part for name, part in runner.children(digest) or ()}
    return {row: str(publish(runner, part, runner.place.store / "models" / f"{place.name}-{row}")) for row, part in found.items()}


def _refused(report: RunReport, source: Source | None) -> None:
    """Videos that the source refused count as failures of the reader."""
    for refused in source.refused if source else ():
        stage = "mesh_read" if source and source.kind == "meshes" else "source_read"
        report.failures.append(Failure(stage, refused.video_id, refused.reason))
        report.failed[stage] = report.failed.get(stage, 0) + 1


def _metrics(report: RunReport, outputs: dict[str, str]) -> dict[str, float]:
    """What the report measured, and the CPU time that was spent on a frame or an image."""
    if "report" not in outputs:
        found = {stage: json.loads((Path(outputs[stage]) / "metrics.json").read_text()) for stage in REPORTS if stage in outputs}
        return {f"{stage}.{name}": value for stage, metrics in found.items() for name, value in metrics.items()}
    metrics: dict[str, float] = json.loads((Path(outputs["report"]) / "metrics.json").read_text())
    more = {"benchmark": _per_image, "extraction_report": _per_frame, "negative_affordance_report": _per_object,
            "grasp_report": _per_step}
    spent = [more[stage](report, metrics) for stage in report.outputs if stage in more]
    return metrics | (spent[0] if spent else {})


def _per_image(report: RunReport, metrics: dict[str, float]) -> dict[str, float]:
    """CPU time of the model's own prediction of a case: reading, network, full-size probabilities and writing."""
    spent = sum(cpu for (name, _), cpu in report.cpu_s.items() if name == "predict_given")
    return {"ms_per_image": 1000 * spent / metrics["cases"]}


def _per_object(report: RunReport, metrics: dict[str, float]) -> dict[str, float]:
    """CPU time of the stages that an object of one's own goes through, from looking at it to its negative surface."""
    scored = {shard for name, shard in report.cpu_s if name == "negative_affordance_score"}
    spent = sum(cpu for (name, shard), cpu in report.cpu_s.items() if name in NEGATIVE and shard in scored)
    return {"cpu_s_per_object": spent / metrics["objects"]}


def _per_step(report: RunReport, metrics: dict[str, float]) -> dict[str, float]:
    """Control steps a CPU second of examinations: physics, observations, policies, figures; PyBullet's has no prefix. Clips that
    are followed and two tasks of one object are none."""
    out: dict[str, float] = {}
    for engine, prefix in (("bullet", ""), ("mujoco", "mujoco.")):
        ends = tuple(f"_{level}_{engine}" for level in LEVELS)
        spent = sum(cpu for (name, _), cpu in report.cpu_s.items() if name.endswith(ends) and not name.startswith("followed_"))
        if spent and f"control_steps.{engine}" in metrics:
            out[f"{prefix}control_steps_per_s"] = metrics[f"control_steps.{engine}"] / spent
    return out


def _per_frame(report: RunReport, metrics: dict[str, float]) -> dict[str, float]:
    """CPU time of the extraction stages per frame (codecs included, recordings not)."""
    out: dict[str, float] = {}
    scored = {shard for name, shard in report.cpu_s if name == "extraction_score"}
    for stage in EXTRACTION:
        spent = sum(cpu for (name, shard), cpu in report.cpu_s.items() if name == stage and shard in scored)
        out[f"cpu_s_per_frame.{stage}"] = spent / metrics["clips.frames"]
    return out | {"cpu_s_per_frame": sum(out.values())}


def _show(summary: Summary, report: RunReport, source: Source | None) -> None:
    console = Console(stderr=True, width=None if sys.stderr.isatty() else PIPED_WIDTH)
    table = Table("stage", "ran", "cached", "failed", "CPU s", box=None)
    for stage in _stages(summary):
        cpu = sum(seconds for (name, _), seconds in report.cpu_s.items() if name == stage)
        cells = [str(counts.get(stage, "") or "") for counts in (summary.ran, summary.cached, summary.failed)]
        table.add_row(stage, *cells, f"{cpu:.1f}")
    console.print(table)
    if source and source.missing:
        console.print(f"no video for {len(source.missing)} annotated video(s): {escape(', '.join(source.missing[:8]))}"
                      + (" ..." if len(source.missing) > 8 else ""))  # fmt: skip
    if report.left:
        console.print(f"time is over: {sum(report.left.values())} task(s) left, of {', '.join(report.left)}; run again to go on",
                      highlight=False)
    for note in report.stale:
        console.print(f"[yellow]stale[/] {escape(note)}", highlight=False)
    _show_failures(console, report.failures)
    for name, path in summary.outputs.items():
        console.print(f"[bold]{name}[/] {escape(path)}", highlight=False, soft_wrap=True)
        for line in content(Path(path)) if name == "dataset" else ():
            console.print(f"  {line}", highlight=False, soft_wrap=True)
    for note in summary.notes or ():
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False, soft_wrap=True)
    few = len(summary.metrics) <= MANY
    for name in sorted(name for name in summary.metrics if few or name.count(".") <= 1):
        console.print(f"  {name:<44} {summary.metrics[name]:.4f}", highlight=False)
    console.print(f"{summary.seconds:.1f} s")


def _where(report: RunReport) -> None:
    """How to look at what one stage has made that has no other name."""
    for stage, made in report.outputs.items():
        for shard, digest in made[:MANY_SHARDS]:
            sys.stderr.write(f"{stage} {shard}: python pipeline.py inspect {digest[:12]}\n")
        if len(made) > MANY_SHARDS:
            sys.stderr.write(f"and {len(made) - MANY_SHARDS} more\n")


def _stages(summary: Summary) -> Iterable[str]:
    return dict.fromkeys([*summary.cached, *summary.ran, *summary.failed])


def _show_failures(console: Console, failures: list[Any]) -> None:
    if not failures:
        return
    table = Table("stage", "clip", title="[red]failed[/]", box=None, title_justify="left")
    table.add_column("what happened", overflow="fold")
    for failure in failures:
        table.add_row(failure.stage, escape(failure.shard), escape(failure.message))
    console.print(table)
