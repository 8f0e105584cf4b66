"""Rows of SOR3D-AFF's ablation: the trainings of each row, and the figures that the paper reports on its own data.

One row is ours: it measures the value of pre-training on actions.
"""

from __future__ import annotations

from collections.abc import Iterable

from afford.rgbd.model.config import ROWS
from schemas.training import Recipe

WHOLE = "rgbd_attention_flow3d"
"""the row that is the paper's model"""
PRETRAINED = "pretrained"
"""the same row with an encoder that was pre-trained on actions"""
ALL = (*ROWS, PRETRAINED)


def recipes(rows: Iterable[str], seeds: Iterable[int], variant: str = "small") -> tuple[Recipe, ...]:
    """List all rows with the first seed, then all rows with the next: an ablation that is stopped early has some of each.

    ValueError for an unknown row.
    """
    rows, seeds = tuple(rows), tuple(seeds)
    unknown = sorted(set(rows) - set(ALL))
    if unknown or not rows or not seeds:
        raise ValueError(f"sor3d: expected rows of {', '.join(ALL)} and at least one seed, got rows {unknown or rows} and "
                         f"{len(seeds)} seeds")
    return tuple(_recipe(row, seed, variant) for seed in seeds for row in rows)


def row_label(recipe: Recipe) -> str:
    """Row of the table that a recipe belongs to: its ablation row, or PRETRAINED."""
    return recipe.name.rpartition("-")[0]


def _recipe(name: str, seed: int, variant: str) -> Recipe:
    data = "actions" if name == PRETRAINED else "interactions"
    return Recipe(name=f"{name}-{seed}", row=WHOLE if name == PRETRAINED else name, variant=variant, hypotheses=1, text=False,
                  decoders=1, target="affordance", seed=seed, data=data, pretrained=False, taxonomy=False, steps=0)  # fmt: skip


PUBLISHED_MODEL: dict[str, tuple[float, float, float]] = {"video": (0.72, 0.80, 0.81), "static": (0.54, 0.58, 0.59)}
"""IoU, F, weighted F of the paper's model, on videos and on pictures"""
PUBLISHED_AFFORDANCENET = (0.56, 0.62, 0.62)
"""the same of AffordanceNet on pictures; it is trained with boxes"""
PUBLISHED_ROWS: dict[str, tuple[float, float]] = {
    "rgb": (0.62, 0.73),
    "rgb_attention": (0.65, 0.77),
    "rgb_attention_flow2d": (0.66, 0.78),
    "rgbd": (0.64, 0.77),
    "rgbd_attention": (0.70, 0.79),
    "rgbd_attention_flow3d": (0.72, 0.80),
}
"""IoU, F of the rows of the paper's ablation, on videos"""
STEPS: tuple[tuple[str, str, str], ...] = (
    ("attention", "rgb", "rgb_attention"),
    ("2-D flow", "rgb_attention", "rgb_attention_flow2d"),
    ("depth", "rgb", "rgbd"),
    ("attention, with depth", "rgbd", "rgbd_attention"),
    ("depth, with attention", "rgb_attention", "rgbd_attention"),
    ("3-D flow", "rgbd_attention", "rgbd_attention_flow3d"),
    ("learning actions before", "rgbd_attention_flow3d", "pretrained"),
)
"""part of the model, row without it, row with it"""
