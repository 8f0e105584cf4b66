"""Counts -> the RGB-D interactions to render, for training and for validation.

Reads   nothing but its parameters
Writes  InteractionSpec of every sequence: object, affordance, instance, person, seeds
Method  affordances by the weights of the paper, object types in turn (afford/dataset/affordance_rules.py lists their
        affordances); no instance (shape, size, colours) and no person is in both splits
Fails   when there is no sequence to plan, or a split has no instance or no person
Paper   SOR3D-AFF, section 6 (962 + 239 sequences, nine affordances, ten object types)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.interaction import InteractionSpec

LIBRARIES = ("numpy",)
THREADS = 1
MEMORY_GIB = 0.2


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    seed: int = 20266
    """seed of all sequences; each draws its own from it"""
    train: int = 360
    """training sequences (the paper: 962)"""
    val: int = 60
    """validation sequences (the paper: 239)"""
    train_instances: int = 16
    """training instances of each object type"""
    val_instances: int = 4
    """validation instances of each object type, in no training sequence"""
    train_subjects: int = 9
    """people of the training split"""
    val_subjects: int = 4
    """people of the validation split, in no training sequence"""


def run(params: Params) -> tuple[InteractionSpec, ...]:
    """Return all sequences, training ones first."""
    from afford.synthetic.splits import interaction_specs

    counts = (params.train_instances, params.val_instances, params.train_subjects, params.val_subjects)
    if min(params.train, params.val) < 0 or params.train + params.val == 0 or min(counts) < 1:
        raise ValueError("interaction_plan: expected at least one sequence, and at least one instance and one subject of each "
                         f"split, got {params}")
    first = params.train_subjects + 1
    return (*interaction_specs("train", params.train, params.train_instances, range(1, first), params.seed),
            *interaction_specs("val", params.val, params.val_instances, range(first, first + params.val_subjects), params.seed))
