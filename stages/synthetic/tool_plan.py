"""Seed and counts -> the objects of the training stills that show one object alone on a table.

Reads   nothing
Writes  ObjectSpec of every object, splits train and val
Method  trained categories without those whose kind training rooms hold out; streams of seeds as in object_plan, with another seed
Fails   when there is no training object, or a category is not one of these
Paper   no paper; docs/synthetic/stills.md lists what the benchmark holds out
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mesh import ObjectSpec

LIBRARIES = ("numpy",)
THREADS = 1
MEMORY_GIB = 0.2


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    categories: tuple[str, ...] = ()
    """categories to show; empty for all"""
    seed: int = 20271
    """seed of all objects; each draws its own from it"""
    per_category: int = 0
    """training objects of each category; 0: no objects alone in the training set"""
    val_every: int = 6
    """one validation object for every n-th category; 0 for none"""


def run(params: Params) -> tuple[ObjectSpec, ...]:
    """Return the objects of both splits."""
    from afford.synthetic.splits import ALONE_CATEGORIES, object_specs

    if params.per_category < 1 or params.val_every < 0:
        raise ValueError(f"tool_plan: expected 1 object a category or more and val_every of 0 or more, got {params}")
    if unknown := set(params.categories) - set(ALONE_CATEGORIES):
        raise ValueError(f"tool_plan.categories: expected some of {', '.join(ALONE_CATEGORIES)}, got {', '.join(sorted(unknown))}")
    shown = params.categories or ALONE_CATEGORIES
    checked = shown[:: params.val_every] if params.val_every else ()
    return (*object_specs("train", shown, params.per_category, params.seed, 3), *object_specs("val", checked, 1, params.seed, 0))
