"""Seed and counts -> the procedural objects to build, for training, validation and evaluation.

Reads   nothing
Writes  ObjectSpec of every object; splits train and val (trained categories), seen (trained categories in new shapes) and
        unseen (categories that training never shows, afford/synthetic/splits.py)
Method  each split and category has its own stream of seeds; looks alternate, so that half of the evaluation objects have a
        single material
Fails   when there is no object to build
Paper   AffordDex, NAA, uses meshes of OakInk2 and UniDexGrasp; these objects stand in where they are absent
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

    splits: tuple[str, ...] = ("train", "val", "seen", "unseen")
    """splits to build"""
    categories: tuple[str, ...] = ()
    """categories to build; empty for all"""
    seed: int = 20264
    """seed of all objects; each draws its own from it"""
    train_per_category: int = 8
    """training objects of each trained category"""
    val_per_category: int = 1
    """validation objects of each trained category"""
    seen_per_category: int = 2
    """evaluation objects of each trained category"""
    unseen_per_category: int = 4
    """evaluation objects of each category that training never shows"""
    train_plain_every: int = 4
    """every n-th training and validation object has a single material; 0 for none"""


def run(params: Params) -> tuple[ObjectSpec, ...]:
    """Return the objects of all splits."""
    from afford.synthetic.splits import TRAINED_CATEGORIES, UNSEEN_CATEGORIES, object_specs

    plain = params.train_plain_every
    rows = (
        ("train", TRAINED_CATEGORIES, params.train_per_category, plain),
        ("val", TRAINED_CATEGORIES, params.val_per_category, plain),
        ("seen", TRAINED_CATEGORIES, params.seen_per_category, 2),
        ("unseen", UNSEEN_CATEGORIES, params.unseen_per_category, 2),
    )
    if min(count for _, _, count, _ in rows) < 0 or plain < 0 or not any(count for _, _, count, _ in rows):
        raise ValueError(f"object_plan: expected counts of 0 or more and at least one object, got {params}")
    if unknown := set(params.splits) - {split for split, *_ in rows}:
        raise ValueError(f"object_plan.splits: expected train, val, seen or unseen, got {', '.join(sorted(unknown))}")
    if unknown := set(params.categories) - {*TRAINED_CATEGORIES, *UNSEEN_CATEGORIES}:
        known = ", ".join((*TRAINED_CATEGORIES, *UNSEEN_CATEGORIES))
        raise ValueError(f"object_plan.categories: expected some of {known}, got {', '.join(sorted(unknown))}")
    return tuple(spec for split, categories, count, every in rows if split in params.splits
                 for spec in object_specs(split, categories, count, params.seed, every)
                 if spec.category in (params.categories or categories))  # fmt: skip
