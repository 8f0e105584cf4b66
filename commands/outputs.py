"""Outputs of a run: published where the map says, measured as the map says."""

from __future__ import annotations

import json
from pathlib import Path

from commands.part import Publisher
from commands.publish import FILES, owned, publish, publish_files, retire
from maps.settings import Origin
from runner import Graph, RunReport
from runner.labels import Cost, Measured, Published

CLIP = "{clip}"


def published(to: Publisher, graph: Graph, report: RunReport, place: Origin, every: bool) -> dict[str, str]:
    """Publish what was made and has a place; name -> path. Where `every` clip was asked for and none failed, recordings of clips
    that are no more go. Errors as `publish`.
    """
    out: dict[str, str] = {}
    for one in graph.published:
        stage = graph.nodes[one.node].name
        made = report.outputs.get(stage)
        if made:
            path = to.runner.place.store / one.place.format(source=place.of(one.part).name, clip=CLIP)
            out[_named(one, one.name)] = _publish(to, stage, made, path, every and report.ok and not report.left)
    return out


def _publish(to: Publisher, stage: str, made: list[tuple[str, str]], path: Path, whole: bool) -> str:
    """One place: of a file or of a folder, for the whole run or for each clip."""
    clips = {path.name.replace(CLIP, shard.rpartition("/")[2]): digest for shard, digest in made}
    if not path.suffix:
        return _folders(to, stage, made, path)
    if CLIP in path.name:
        _files(to, clips, path.parent, whole)
    else:
        to.file(stage, made[-1][1], path)
    return str(path.parent)


def _folders(to: Publisher, stage: str, made: list[tuple[str, str]], path: Path) -> str:
    """A folder for the whole run, or one for each clip; then the folder of them all."""
    if CLIP not in path.parts:
        return to.folder(stage, made[-1][1], path)
    for shard, digest in made:
        publish(to.runner, digest, Path(str(path).replace(CLIP, shard.rpartition("/")[2])))
    return str(Path(*path.parts[: path.parts.index(CLIP)]))


def _files(to: Publisher, clips: dict[str, str], folder: Path, whole: bool) -> None:
    """A recording of each clip."""
    publish_files(to.runner, clips, folder)
    with owned(to.runner.place.store, folder):
        retire(folder, set(clips), whole)


def measured(to: Publisher, graph: Graph, report: RunReport) -> dict[str, float]:
    """The figures that the map names, and what stages cost that are counted in them."""
    out: dict[str, float] = {}
    found: dict[int, dict[str, float]] = {}
    for one in graph.measured:
        made = report.outputs.get(graph.nodes[one.node].name)
        if made:
            found[one.node] = json.loads(to.runner.file(made[-1][1], FILES + one.file).read_text())
            out |= {_named(one, one.under + name): value for name, value in found[one.node].items()}
    for cost in graph.costs:
        out |= {_named(cost, name): value for name, value in costs(cost, report, found.get(cost.measured, {})).items()}
    return out


def costs(cost: Cost, report: RunReport, figures: dict[str, float]) -> dict[str, float]:
    """What stages cost in these figures; nothing where the figure is not there, or nothing was spent."""
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
    """A name in the summary, after that of its target where several are made together."""
    return f"{label.part}.{name}" if label.part else name
