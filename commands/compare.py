"""Compare backends: `run extraction-report --set STAGE.backend=a,b` scores the same clips with each, and their costs."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path

from commands.errors import UsageError
from commands.outputs import Publisher
from commands.publish import publish, publish_text
from commands.targets import build
from maps.extraction import compared
from maps.settings import Origin, Settings
from runner import Graph, GraphError, RunReport

REPORT, SCORE = "extraction_report", "extraction_score"
Names = Mapping[str, Mapping[str, str]]
"""column -> stage -> name of the stage in the graph"""


def build_columns(target: str, place: Origin, columns: Mapping[str, Settings]) -> tuple[Graph, Names]:
    """Graph of a target, or of a comparison for several columns, and the stage names of each column.

    UsageError for parameters that do not allow a graph.
    """
    if len(columns) == 1:
        return _single(target, place, next(iter(columns.values()))), {}
    if target != "extraction-report":
        raise UsageError(f"--set with backends {', '.join(columns)}: only extraction-report compares several backends; choose one "
                         f"for {target}")
    graph = Graph()
    return graph, compared(graph, place, columns)


def _single(target: str, place: Origin, chosen: Settings) -> Graph:
    try:
        return build(target, place, chosen)
    except GraphError:  # a defect of the project
        raise
    except ValueError as error:
        raise UsageError(str(error)) from error


def publish_columns(to: Publisher, report: RunReport, names: Names, folder: Path) -> tuple[dict[str, str], dict[str, float]]:
    """Publish the report of every column, a comparison page, and the metrics of all columns.

    If one of the reports is partial, the folder is published as partial. Errors as `publish`.
    """
    folder = to.together((stages[REPORT] for stages in names.values()), folder)
    metrics: dict[str, dict[str, float]] = {}
    for label, stages in names.items():
        for _, digest in report.outputs[stages[REPORT]]:
            place = publish(to.runner, digest, folder / label)
            found: dict[str, float] = json.loads((place / "metrics.json").read_text())
            metrics[label] = found | dict(_costs(report, stages, found["clips.frames"]))
    if not metrics:
        return {}, {}
    differing = [stage for stage in next(iter(names.values())) if len({own.get(stage) for own in names.values()}) > 1]
    publish_text(to.runner, page(metrics, differing), folder / "compare.md")
    flat = {f"{label}.{name}": value for label, found in metrics.items() for name, value in found.items()}
    publish_text(to.runner, json.dumps(flat, indent=1, sort_keys=True) + "\n", folder / "metrics.json")
    return {"report": str(folder), "page": str(folder / "compare.md")}, flat


def _costs(report: RunReport, stages: Mapping[str, str], frames: float) -> Iterator[tuple[str, float]]:
    """Yield CPU time per frame and peak memory of every stage on the scored clips, codecs included."""
    scored = {shard for name, shard in report.cpu_s if name == stages[SCORE]}
    for stage, own in stages.items():
        if stage not in (REPORT, SCORE):
            yield f"cpu_ms_per_frame.{stage}", 1000 * sum(report.cpu_s.get((own, shard), 0.0) for shard in scored) / frames
            yield f"peak_mib.{stage}", max((report.peak_mib.get((own, shard), 0.0) for shard in scored), default=0.0)


def page(metrics: Mapping[str, Mapping[str, float]], stages: list[str]) -> str:
    """Markdown table: measures as rows, columns across; then the costs of the stages that differ."""
    from afford.extraction.quality_report import ROWS

    labels, first = list(metrics), next(iter(metrics.values()))
    rows = [(title, name) for title, name, _ in ROWS] + [(f"hard clips: {title}", f"hard.{name}") for title, name, _ in ROWS]
    costs = [(f"{stage}, {unit}", f"{kind}.{stage}") for stage in stages
             for kind, unit in (("cpu_ms_per_frame", "CPU ms a frame"), ("peak_mib", "peak MiB")) if stage not in (REPORT, SCORE)]
    standard, hard, frames = (int(first[f"clips.{name}"]) for name in ("standard", "hard", "frames"))
    head = (f"# Extraction, backends side by side\n\n{standard} standard and {hard} hard clips, {frames} frames, the same for "
            "every column.\n\n")
    return head + _table("measure", rows, metrics, labels, 3) + "\nCost of the stages that differ:\n\n" + _table(
        "stage", costs, metrics, labels, 1)


def _table(title: str, rows: list[tuple[str, str]], metrics: Mapping[str, Mapping[str, float]], labels: list[str],
           digits: int) -> str:  # fmt: skip
    lines = [f"| {title} | " + " | ".join(labels) + " |", "|---|" + "--:|" * len(labels)]
    for words, name in rows:
        if any(name in metrics[label] for label in labels):
            cells = [f"{metrics[label][name]:.{digits}f}" if name in metrics[label] else "" for label in labels]
            lines.append(f"| {words} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
