"""Picture of the graph of stages."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from matplotlib.path import Path as Curve
from matplotlib.text import Text

from afford.common.figures import Figure

COLUMN, ROW = 2.6, 1.0
"""distance between the centres of two boxes, in figure units"""
COLUMN_IN, ROW_IN = 2.7, 0.75
"""the same distance in inches"""
LINE = "#7a8794"


def draw_graph(stages: list[str], edges: list[tuple[str, str]], path: Path) -> None:
    """Draw boxes in columns by depth, and an arrow from each stage to the stages that read it; the suffix gives the format.

    ValueError when the suffix is neither .svg nor .png.
    """
    if path.suffix not in (".svg", ".png"):
        raise ValueError(f"{path}: expected a file name that ends in .svg or .png")
    figure, _ = graph_figure(stages, edges)
    figure.savefig(path, dpi=110, metadata={"Date": None} if path.suffix == ".svg" else {"Software": None})


def graph_figure(stages: list[str], edges: list[tuple[str, str]]) -> tuple[Figure, dict[str, Text]]:
    """Build the figure, and the box of each stage. Arrows run from the right edge of a box to the left edge of another."""
    depth = _depths(stages, edges)
    columns = {level: [s for s in stages if depth[s] == level] for level in sorted(set(depth.values()))}
    tallest = max(map(len, columns.values()))
    figure = Figure(figsize=(COLUMN_IN * len(columns), max(2.0, ROW_IN * tallest)))
    axes = figure.add_axes((0.01, 0.02, 0.98, 0.96))
    axes.set(xlim=(-COLUMN / 2, COLUMN * (max(columns) + 0.5)), ylim=(-ROW * tallest / 2 - 0.1, ROW * tallest / 2 + 0.1))
    axes.axis("off")
    boxes = {stage: _box(axes, stage, COLUMN * level, -ROW * (i - (len(column) - 1) / 2))
             for level, column in columns.items() for i, stage in enumerate(column)}  # fmt: skip
    figure.draw_without_rendering()  # boxes are as wide as their text, which only a renderer can measure
    to_units = axes.transData.inverted()
    ends = {stage: to_units.transform_bbox(_patch(box).get_window_extent()) for stage, box in boxes.items()}
    for source, target in edges:
        start, end = ends[source], ends[target]
        axes.add_patch(_arrow((start.x1, (start.y0 + start.y1) / 2), (end.x0, (end.y0 + end.y1) / 2)))
    return figure, boxes


def _box(axes: Axes, stage: str, x: float, y: float) -> Text:
    """Draw the box of a stage with its name, in two lines where it is long."""
    fill = "#f0f4f8" if stage.startswith("record") else "#d7e6f5"
    box = {"boxstyle": "round,pad=0.45", "fc": fill, "ec": "#34495e", "lw": 0.9}
    name = stage.replace("_", "\n", 1) if len(stage) > 18 else stage
    return axes.text(x, y, name, ha="center", va="center", fontsize=8.5, bbox=box, zorder=3)


def _patch(box: Text) -> FancyBboxPatch:
    patch = box.get_bbox_patch()
    assert patch is not None  # every text here has one
    return patch


def _arrow(start: tuple[float, float], end: tuple[float, float]) -> FancyArrowPatch:
    """Curved arrow with horizontal ends."""
    bend = min(0.6, (end[0] - start[0]) / 2)
    points = [start, (start[0] + bend, start[1]), (end[0] - bend, end[1]), end]
    curve = Curve(points, [Curve.MOVETO, Curve.CURVE4, Curve.CURVE4, Curve.CURVE4])
    return FancyArrowPatch(path=curve, arrowstyle="-|>", mutation_scale=9, color=LINE, lw=0.9, shrinkA=0, shrinkB=0, zorder=1)


def _depths(stages: list[str], edges: list[tuple[str, str]]) -> dict[str, int]:
    """Length of the longest path to each stage; `stages` is in topological order."""
    depth = dict.fromkeys(stages, 0)
    for stage in stages:
        depth[stage] = max((depth[source] + 1 for source, target in edges if target == stage), default=0)
    return depth
