"""Pictures of the statistics: classes, areas, taxonomy and where hands act. The same numbers give the same bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg

from afford.common import palette
from afford.common.figures import Figure
from afford.dataset.tally import Tally
from schemas.video import SIDES

LEFT, RIGHT, NEW = (palette.web(colour) for colour in (palette.LEFT, palette.RIGHT, palette.OBJECTS[2]))
NEUTRAL = "#5b6770"
TOP_CLASSES = 25
NARROW, WIDE, FLAT = (7.0, 4.0), (11.0, 5.5), (11.0, 3.4)
AREA_PERCENT = np.geomspace(0.01, 100, 41).tolist()


def write(root: Path, tally: Tally, statistics: dict[str, Any]) -> None:
    """classes.png, areas.png, taxonomy.png and hand_positions.png under `plots/`."""
    folder = root / "plots"
    folder.mkdir(parents=True, exist_ok=True)
    _save(_classes(statistics), folder / "classes.png")
    _save(_areas(tally), folder / "areas.png")
    _save(_taxonomy(statistics), folder / "taxonomy.png")
    _save(_hand_positions(tally), folder / "hand_positions.png")


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


def _areas(tally: Tally) -> Figure:
    figure, axes = _figure(WIDE, 2)
    panels = (("affordance", "mask_left", "mask_right"), ("complete object", "object_left_mask", "object_right_mask"))
    for axis, (title, left, right) in zip(axes, panels, strict=True):
        found = [[100 * area for area in tally.areas[name]] for name in (left, right)]
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


def _hand_positions(tally: Tally) -> Figure:
    figure, axes = _figure(FLAT, 2)
    for axis, title, heat, colours in zip(axes, SIDES, tally.heat, ("Oranges", "Blues"), strict=True):
        percent = 100 * heat / max(tally.splits.total(), 1)
        shown = axis.imshow(percent, cmap=colours, vmin=0, extent=(0, 1, 1, 0), aspect=percent.shape[0] / percent.shape[1],
                            interpolation="bilinear")
        axis.set(title=f"where the {title} hand acts", xlabel="x / width", ylabel="y / height")
        figure.colorbar(shown, ax=axis, label="% of samples")
    return figure
