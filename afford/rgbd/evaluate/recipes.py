"""The trainings of SOR3D-AFF's ablation, and the one more that tells what pre-training is worth."""

from __future__ import annotations

from collections.abc import Iterable

from afford.rgbd.model.config import ROWS
from schemas.training import Recipe

WHOLE = "rgbd_attention_flow3d"
"""the row that is the paper's model"""
PRETRAINED = "pretrained"
"""the same on an encoder that learned actions before"""
ALL = (*ROWS, PRETRAINED)


def recipes(rows: Iterable[str], seeds: Iterable[int], variant: str = "small") -> tuple[Recipe, ...]:
    """Every row with the first seed, then every row with the next: what is stopped early has something of each. ValueError for an
    unknown row.
    """
    rows, seeds = tuple(rows), tuple(seeds)
    unknown = sorted(set(rows) - set(ALL))
    if unknown or not rows or not seeds:
        raise ValueError(f"sor3d: expected rows of {', '.join(ALL)} and at least one seed, got rows {unknown or rows} and "
                         f"{len(seeds)} seeds")
    return tuple(_recipe(row, seed, variant) for seed in seeds for row in rows)


def label(recipe: Recipe) -> str:
    """The line of the table that a recipe belongs to: its row, or PRETRAINED."""
    return recipe.name.rpartition("-")[0]


def _recipe(name: str, seed: int, variant: str) -> Recipe:
    data = "actions" if name == PRETRAINED else "interactions"
    return Recipe(name=f"{name}-{seed}", row=WHOLE if name == PRETRAINED else name, variant=variant, hypotheses=1, text=False,
                  decoders=1, target="affordance", seed=seed, data=data)  # fmt: skip
