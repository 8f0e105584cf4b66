"""Publish the outputs of a run at the places that the graph declares, and collect its metrics.

An output made from less than the whole source does not replace a complete one. It is published as partial, under the name
`<name>-part`.

A data set, a model or a report is partial when the run was limited to some clips, when a task behind it failed, or, for data sets,
when the published one has more videos or splits. A table that a run with a time limit has not finished is partial when the
published one has figures that it lacks. `--replace` publishes a partial output under the complete name.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from commands.publish import FILES, publish, publish_file, publish_files, publish_lock, retire_recordings, shows_file, shows_folder
from maps.settings import Origin
from runner import Graph, Runner, RunReport
from runner.graph import Cost, Measured, Published

PART = "-part"
STATISTICS, METRICS = "statistics.json", "metrics.json"
RECORDS = "record_"
"""prefix of the names of recording stages"""


@dataclass
class Publisher:
    """Publishes the outputs of one run.

    `why` maps stages with partial outputs to the reason; `notes` collects messages for the user.
    """

    runner: Runner
    why: dict[str, str] = field(default_factory=dict)
    replace: bool = False
    unfinished: bool = False
    notes: list[str] = field(default_factory=list)

    def folder(self, stage: str, digest: str, folder: Path) -> str:
        """Publish a folder, as partial if necessary; return its path. Errors as `publish`."""
        if self.replace or shows_folder(self.runner, digest, folder):
            return str(publish(self.runner, digest, folder))
        why = self.why.get(stage) or self._smaller(digest, folder)
        if why:
            self.why[stage] = why
            self._note(folder.with_name(folder.name + PART), folder, why)
        return str(publish(self.runner, digest, folder.with_name(folder.name + PART) if why else folder))

    def file(self, stage: str, digest: str, path: Path) -> str:
        """Publish a recording, which is partial if the recorded output is."""
        why = self.why.get(stage) or self.why.get(stage.removeprefix(RECORDS))
        whole = self.replace or not why or shows_file(self.runner, digest, path)
        return str(publish_file(self.runner, digest, path if whole else path.with_stem(path.stem + PART)))

    def together(self, stages: Iterable[str], folder: Path) -> Path:
        """Folder for outputs of several stages; the partial one if one of the outputs is partial."""
        why = "" if self.replace else next((self.why[stage] for stage in stages if stage in self.why), "")
        if why:
            self._note(folder.with_name(folder.name + PART), folder, why)
        return folder.with_name(folder.name + PART) if why else folder

    def _note(self, part: Path, whole: Path, why: str) -> None:
        hint = f"{whole} is unchanged, --replace overwrites it" if whole.exists() else f"--replace publishes it as {whole.name}"
        self.notes.append(f"{part.name} is partial: {why}; {hint}")

    def _smaller(self, digest: str, folder: Path) -> str:
        """Reason why the published folder holds more, '' if it does not."""
        files = self.runner.files(digest)
        new, old = (_object(path) for path in (files.get(FILES + STATISTICS), folder / STATISTICS))
        for what, count in (("video(s)", _videos), ("split(s)", _splits)):
            if new and count(new) < count(old):
                return f"it has {count(new)} {what}, {folder.name} has {count(old)}"
        lacking = _object(folder / METRICS).keys() - _object(files.get(FILES + METRICS)).keys() if self.unfinished else ()
        return f"it is unfinished and lacks {len(lacking)} figure(s) of {folder.name}" if lacking else ""


def partial_outputs(graph: Graph, report: RunReport, clips: tuple[str, ...], refused: int) -> dict[str, str]:
    """Map each stage of the target with a partial output to the reason.

    `refused` is the number of videos of the source that could not be read.
    """
    out: dict[str, str] = {}
    for stage in report.outputs:
        feeding = {node.name for node in graph.upstream(node for node in graph.nodes if node.name == stage)}
        failed = sum(failure.stage in feeding for failure in report.failures) + refused
        if clips:
            out[stage] = f"made from {', '.join(clips[:3])}{' ...' if len(clips) > 3 else ''} alone"
        elif failed:
            out[stage] = f"{failed} of the tasks behind it failed"
    return out


def _object(path: Path | None) -> Mapping[str, Any]:
    """Object in a JSON file; an empty one if the file is missing or invalid."""
    try:
        found = json.loads(path.read_bytes()) if path else {}
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _videos(statistics: Mapping[str, Any]) -> int:
    found = statistics.get("videos")
    return found if isinstance(found, int) else 0


def _splits(statistics: Mapping[str, Any]) -> int:
    found = statistics.get("splits")
    return len(found) if isinstance(found, dict) else 0


CLIP = "{clip}"


def publish_outputs(to: Publisher, graph: Graph, report: RunReport, place: Origin, every: bool) -> dict[str, str]:
    """Publish all outputs that have a place; map name to path.

    If `every` clip was requested and none failed, recordings of removed clips are deleted. Errors as `publish`.
    """
    out: dict[str, str] = {}
    for one in graph.published:
        stage = graph.nodes[one.node].name
        made = report.outputs.get(stage)
        if made:
            path = to.runner.store.root / one.place.format(source=place.of(one.part).name, clip=CLIP)
            out[_named(one, one.name)] = _publish(to, stage, made, path, every and report.ok and not report.deferred)
    return out


def _publish(to: Publisher, stage: str, made: list[tuple[str, str]], path: Path, whole: bool) -> str:
    """Publish at one place: a file or a folder, for the whole run or for each clip."""
    clips = {path.name.replace(CLIP, shard.rpartition("/")[2]): digest for shard, digest in made}
    if not path.suffix:
        return _folders(to, stage, made, path)
    if CLIP in path.name:
        _files(to, clips, path.parent, whole)
    else:
        to.file(stage, made[-1][1], path)
    return str(path.parent)


def _folders(to: Publisher, stage: str, made: list[tuple[str, str]], path: Path) -> str:
    """Publish one folder for the whole run, or one per clip; return the folder that contains them."""
    if CLIP not in path.parts:
        return to.folder(stage, made[-1][1], path)
    for shard, digest in made:
        publish(to.runner, digest, Path(str(path).replace(CLIP, shard.rpartition("/")[2])))
    return str(Path(*path.parts[: path.parts.index(CLIP)]))


def _files(to: Publisher, clips: dict[str, str], folder: Path, whole: bool) -> None:
    """Publish one recording per clip."""
    publish_files(to.runner, clips, folder)
    with publish_lock(to.runner.store.root, folder):
        retire_recordings(folder, set(clips), whole)


def collect_metrics(to: Publisher, graph: Graph, report: RunReport) -> dict[str, float]:
    """Figures and stage costs that the graph declares."""
    out: dict[str, float] = {}
    found: dict[int, dict[str, float]] = {}
    for one in graph.measured:
        made = report.outputs.get(graph.nodes[one.node].name)
        if made:
            found[one.node] = json.loads(to.runner.file(made[-1][1], FILES + one.file).read_text())
            out |= {_named(one, one.under + name): value for name, value in found[one.node].items()}
    for cost in graph.costs:
        out |= {_named(cost, name): value for name, value in stage_costs(cost, report, found.get(cost.measured, {})).items()}
    return out


def stage_costs(cost: Cost, report: RunReport, figures: dict[str, float]) -> dict[str, float]:
    """Cost of stages per unit of a figure; empty without the figure, or if no time was spent."""
    shards = {shard for stage, shard in report.cpu_s if stage == cost.shards}
    spent = {(stage, shard): seconds for (stage, shard), seconds in report.cpu_s.items()
             if stage in cost.stages and (cost.shards is None or shard in shards)}  # fmt: skip
    if cost.per not in figures or not sum(spent.values()):
        return {}
    count = figures[cost.per]
    if cost.rate:
        return {cost.name: count / sum(spent.values())}
    if not cost.each:
        return {cost.name: cost.scale * sum(spent.values()) / count}
    each = {f"{cost.name}.{stage}": cost.scale * sum(cpu for (name, _), cpu in spent.items() if name == stage) / count
            for stage in cost.stages}  # fmt: skip
    return each | {cost.name: sum(each.values())}


def _named(label: Published | Measured | Cost, name: str) -> str:
    """Name in the summary, prefixed with the target for combined targets."""
    return f"{label.part}.{name}" if label.part else name
