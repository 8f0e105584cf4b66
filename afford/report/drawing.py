"""The graph of stages as a picture."""

from __future__ import annotations

from pathlib import Path

from afford.figures import Figure


def draw(stages: list[str], edges: list[tuple[str, str]], path: Path) -> None:
    """Boxes in columns by depth, arrows from what is read to what reads it; the suffix of `path` gives the format.

    ValueError when the suffix is neither .svg nor .png.
    """
    if path.suffix not in (".svg", ".png"):
        raise ValueError(f"{path}: expected a name that ends in .svg or .png")
    depth = _depths(stages, edges)
    columns = {level: [s for s in stages if depth[s] == level] for level in sorted(set(depth.values()))}
    place = {s: (2.6 * level, -(i - (len(column) - 1) / 2)) for level, column in columns.items() for i, s in enumerate(column)}
    tallest = max(map(len, columns.values()))
    figure = Figure(figsize=(2.7 * len(columns), max(2.0, 0.75 * tallest)))
    axes = figure.add_axes((0.01, 0.02, 0.98, 0.96))
    for source, target in edges:
        (x0, y0), (x1, y1) = place[source], place[target]
        axes.annotate("", (x1 - 1.02, y1), (x0 + 1.02, y0), arrowprops={"arrowstyle": "-|>", "color": "#7a8794", "lw": 0.9})
    for stage, (x, y) in place.items():
        fill = "#f0f4f8" if stage.startswith("record") else "#d7e6f5"
        box = {"boxstyle": "round,pad=0.45", "fc": fill, "ec": "#34495e", "lw": 0.9}
        axes.text(x, y, stage.replace("_", "\n", 1) if len(stage) > 18 else stage, ha="center", va="center", fontsize=8.5, bbox=box)
    axes.set(xlim=(-1.3, 2.6 * max(columns) + 1.3), ylim=(-tallest / 2 - 0.1, tallest / 2 + 0.1))
    axes.axis("off")
    figure.savefig(path, dpi=110, metadata={"Date": None} if path.suffix == ".svg" else {"Software": None})


def _depths(stages: list[str], edges: list[tuple[str, str]]) -> dict[str, int]:
    """Length of the longest way to each stage; `stages` is in an order in which sources come first."""
    depth = dict.fromkeys(stages, 0)
    for stage in stages:
        depth[stage] = max((depth[source] + 1 for source, target in edges if target == stage), default=0)
    return depth
