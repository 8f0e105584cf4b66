"""Statistics of a data set, counted while its rows are written, and their plots. The same numbers give the same bytes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg

from afford.common import palette
from afford.common.figures import Figure
from afford.dataset.table_schema import MASKS, TAXONOMY3, Classes
from schemas.affordance import TAXONOMY, Sample, Samples
from schemas.video import SIDES

GRID = (36, 64)
"""rows and columns of the heat maps"""
PUBLISHED = {"samples": 278_000, "verb_classes": 73, "noun_classes": 163}
"""totals that 2HandedAfforder reports for 2HANDS, for comparison"""
QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)


@dataclass
class DatasetCounts:
    """Counts and distributions; grows by a few numbers per sample."""

    splits: Counter[str] = field(default_factory=Counter)
    verbs: Counter[str] = field(default_factory=Counter)
    nouns: Counter[str] = field(default_factory=Counter)
    objects: Counter[str] = field(default_factory=Counter)
    taxonomy: Counter[int] = field(default_factory=Counter)
    taxonomy3: Counter[int] = field(default_factory=Counter)
    areas: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in MASKS})
    numbers: dict[str, list[float]] = field(
        default_factory=lambda: {name: [] for name in ("quality", "inpaint_confidence", "key_distance")})
    heat: np.ndarray = field(default_factory=lambda: np.zeros((2, *GRID)))

    def add(self, split: str, sample: Sample, row: dict[str, Any]) -> None:
        """Count one sample and its table row."""
        self.splits[split] += 1
        self.verbs[sample.narration.verb_key] += 1
        self.nouns[sample.narration.noun_key] += 1
        self.objects.update(sorted({sample.object_left, sample.object_right} - {""}))
        self.taxonomy[row["taxonomy"]] += 1
        self.taxonomy3[row["taxonomy3"]] += 1
        for name in MASKS:
            if row[f"{name}_area"]:
                self.areas[name].append(row[f"{name}_area"] / (row["width"] * row["height"]))
        for name, found in self.numbers.items():
            found.append(float(row[name]))
        self.heat += on_grid(sample.masks[:2])


def on_grid(masks: np.ndarray) -> np.ndarray:
    """Sample masks (n, h, w) at the middle of each grid cell, (n, *GRID)."""
    rows, columns = (((np.arange(cells) + 0.5) * size / cells).astype(int)
                     for cells, size in zip(GRID, masks.shape[1:], strict=True))
    return masks[:, rows[:, None], columns[None, :]]


def statistics(counts: DatasetCounts, clips: Iterable[Samples], verbs: Classes, nouns: Classes) -> dict[str, Any]:
    """Return the contents of statistics.json."""
    videos: dict[str, str] = {}
    rejected: Counter[str] = Counter()
    for clip in clips:
        videos[clip.video_id] = clip.participant_id
        rejected.update(dict(clip.rejected))
    ours = {"samples": counts.splits.total(), "verb_classes": len(verbs.keys), "noun_classes": len(nouns.keys)}
    return {
        "totals": {name: {"here": ours[name], "published_2hands": PUBLISHED[name]} for name in ours},
        "videos": len(videos),
        "participants": len(set(videos.values())),
        "splits": dict(counts.splits),
        "taxonomy": {name: counts.taxonomy[label] for label, name in enumerate(TAXONOMY)},
        "taxonomy3": {name: counts.taxonomy3[label] for label, name in enumerate(TAXONOMY3)},
        "verbs": _by_class(verbs, counts.verbs),
        "nouns": _by_class(nouns, counts.nouns),
        "objects": dict(sorted(counts.objects.items(), key=lambda item: (-item[1], item[0]))),
        "area_fraction": {name: _distribution(found) for name, found in counts.areas.items()},
        **{name: _distribution(found) for name, found in counts.numbers.items()},
        "frames_without_sample": dict(sorted(rejected.items())),
    }


def _by_class(classes: Classes, count: Counter[str]) -> list[dict[str, Any]]:
    pairs = enumerate(zip(classes.keys, classes.epic_ids, strict=True))
    return [{"label": label, "key": key, "epic_id": epic_id, "samples": count[key]} for label, (key, epic_id) in pairs]


def _distribution(found: list[float]) -> dict[str, float]:
    """Return count, mean and quantiles; only the count for an empty list."""
    if not found:
        return {"count": 0}
    cuts = np.quantile(found, QUANTILES)
    spread = {f"p{100 * at:g}": round(float(cut), 6) for at, cut in zip(QUANTILES, cuts, strict=True)}
    return {"count": len(found), "mean": round(float(np.mean(found)), 6), **spread}


LEFT, RIGHT, NEW = (palette.web(colour) for colour in (palette.LEFT, palette.RIGHT, palette.OBJECTS[2]))
NEUTRAL = "#5b6770"
TOP_CLASSES = 25
NARROW, WIDE, FLAT = (7.0, 4.0), (11.0, 5.5), (11.0, 3.4)
AREA_PERCENT = np.geomspace(0.01, 100, 41).tolist()


def write_plots(root: Path, counts: DatasetCounts, statistics: dict[str, Any]) -> None:
    """Write classes.png, areas.png, taxonomy.png and hand_positions.png under `plots/`."""
    folder = root / "plots"
    folder.mkdir(parents=True, exist_ok=True)
    _save(_classes(statistics), folder / "classes.png")
    _save(_areas(counts), folder / "areas.png")
    _save(_taxonomy(statistics), folder / "taxonomy.png")
    _save(_hand_positions(counts), folder / "hand_positions.png")


def _figure(size: tuple[float, float], columns: int) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=size, dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    axes = list(np.atleast_1d(figure.subplots(1, columns)))
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _save(figure: Figure, path: Path) -> None:
    figure.savefig(path, metadata={"Software": None})


def _classes(statistics: dict[str, Any]) -> Figure:
    figure, axes = _figure(WIDE, 2)
    for axis, kind in zip(axes, ("verb", "noun"), strict=True):
        found = sorted(statistics[f"{kind}s"], key=lambda entry: (-entry["samples"], entry["key"]))
        top = found[:TOP_CLASSES][::-1]
        colours = [NEUTRAL if entry["epic_id"] >= 0 else NEW for entry in top]
        bars = axis.barh([entry["key"] for entry in top], [entry["samples"] for entry in top], color=colours)
        axis.bar_label(bars, padding=3, fontsize=8)
        total = statistics["totals"][f"{kind}_classes"]
        shown = f", {len(top)} shown" if len(found) > len(top) else ""
        axis.set_title(f"{total['here']} {kind} classes{shown} (2HANDS: {total['published_2hands']})", fontsize=10)
        axis.set_xlabel("samples")
        axis.margins(x=0.12)
    if any(entry["epic_id"] < 0 for kind in ("verbs", "nouns") for entry in statistics[kind]):
        figure.supxlabel("violet: classes that EPIC-KITCHENS does not have", fontsize=9, color=NEW)
    return figure


def _areas(counts: DatasetCounts) -> Figure:
    figure, axes = _figure(WIDE, 2)
    panels = (("affordance", "mask_left", "mask_right"), ("complete object", "object_left_mask", "object_right_mask"))
    for axis, (title, left, right) in zip(axes, panels, strict=True):
        found = [[100 * area for area in counts.areas[name]] for name in (left, right)]
        axis.hist([np.maximum(part, AREA_PERCENT[0]) for part in found], AREA_PERCENT, color=[LEFT, RIGHT],
                  label=["left hand", "right hand"])
        axis.set(title=f"area of the {title}", xlabel="% of the image", ylabel="samples", xscale="log")
        axis.xaxis.set_major_formatter("{x:g}")
        axis.legend(frameon=False)
    return figure


def _taxonomy(statistics: dict[str, Any]) -> Figure:
    figure, axes = _figure(NARROW, 2)
    colours = {"taxonomy": (LEFT, RIGHT, NEUTRAL, "#8c9aa5"), "taxonomy3": NEUTRAL}
    for axis, kind in zip(axes, colours, strict=True):
        names = [name.replace("_", "\n") for name in statistics[kind]]
        axis.bar_label(axis.bar(names, list(statistics[kind].values()), color=colours[kind]), fontsize=9, padding=2)
        axis.set_title({"taxonomy": "which hands (4-way)", "taxonomy3": "which hands (3-way)"}[kind], fontsize=10)
        axis.set_ylabel("samples")
    return figure


def _hand_positions(counts: DatasetCounts) -> Figure:
    figure, axes = _figure(FLAT, 2)
    for axis, title, heat, colours in zip(axes, SIDES, counts.heat, ("Oranges", "Blues"), strict=True):
        percent = 100 * heat / max(counts.splits.total(), 1)
        shown = axis.imshow(percent, cmap=colours, vmin=0, extent=(0, 1, 1, 0), aspect=percent.shape[0] / percent.shape[1],
                            interpolation="bilinear")
        axis.set(title=f"where the {title} hand acts", xlabel="x / width", ylabel="y / height")
        figure.colorbar(shown, ax=axis, label="% of samples")
    return figure
