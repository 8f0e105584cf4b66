"""Seed and counts -> the household bodies to build for grasping: tools, vessels and packages.

Reads   nothing
Writes  ObjectSpec of every body; splits train and seen (categories that may be trained on) and unseen (held-out categories, for
        evaluation only; afford/synthetic/objects/household_bodies.py HELD_OUT)
Method  each split and category has its own stream of seeds, from which sizes and shapes are drawn
Fails   when there is no body to build, or a category or split is unknown
Paper   AffordDex grasps objects of UniDexGrasp; these bodies stand in where they are absent
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mesh import ObjectSpec

LIBRARIES = ("numpy", "scipy", "numba", "manifold3d")
THREADS = 1
MEMORY_GIB = 0.3


@dataclass(frozen=True)
class Params:
    """Parameters of `household_plan`."""

    splits: tuple[str, ...] = ("seen", "unseen")
    """splits to build, of train, seen and unseen"""
    categories: tuple[str, ...] = ()
    """categories to build; empty for all"""
    per_category: int = 2
    """bodies of each category of the splits seen and unseen"""
    train_per_category: int = 4
    """bodies of each category of the split train"""
    seed: int = 20270
    """seed of all bodies; each draws its own from it"""


def run(params: Params) -> tuple[ObjectSpec, ...]:
    """Return the bodies of all splits."""
    from afford.synthetic.objects.household_bodies import CATEGORIES, HELD_OUT
    from afford.synthetic.splits import object_specs

    if unknown := {*params.categories} - {*CATEGORIES} | {*params.splits} - {"train", "seen", "unseen"}:
        raise ValueError(f"household_plan: expected splits train, seen or unseen and categories of {', '.join(CATEGORIES)}, got "
                         f"{', '.join(sorted(unknown))}")
    chosen = params.categories or CATEGORIES
    known = tuple(one for one in chosen if one not in HELD_OUT)
    rows = {"train": known, "seen": known, "unseen": tuple(one for one in chosen if one in HELD_OUT)}
    specs = tuple(one for split in params.splits for one in object_specs(
        split, rows[split], params.train_per_category if split == "train" else params.per_category, params.seed, 1))
    if not specs:
        raise ValueError(f"household_plan: expected per_category of 1 or more and a category of the splits, got {params}")
    return specs
