"""counts -> which RGB-D interactions to render, for training and for validation.

Reads   nothing but its parameters
Writes  InteractionSpec of every sequence: thing, affordance, instance, person, seeds
Method  affordances by the weights of the paper, types of things by turns (afford/dataset/affordance_rules.py says what affords
        what); no instance (shape, size, colours) and no person is in both splits
Fails   when there is nothing to plan, or a split has no instance or no person
Paper   SOR3D-AFF, section 6 (962 + 239 sequences, nine affordances, ten types of things)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.interaction import InteractionSpec

LIBRARIES = ("numpy",)
THREADS = 1
MEMORY_GIB = 0.2


@dataclass(frozen=True)
class Params:
    seed: int = 20266
    """seed of all sequences; each draws its own from it"""
    train: int = 360
    """sequences for training (the paper: 962)"""
    val: int = 60
    """sequences for validation (the paper: 239)"""
    train_instances: int = 16
    """instances of each type of thing that training shows"""
    val_instances: int = 4
    """instances of each type of thing that only validation shows"""
    train_subjects: int = 9
    """people who are seen in training"""
    val_subjects: int = 4
    """people who are seen in validation only"""


def run(params: Params) -> tuple[InteractionSpec, ...]:
    """All sequences, those for training first."""
    from afford.synthetic.splits import interaction_specs

    counts = (params.train_instances, params.val_instances, params.train_subjects, params.val_subjects)
    if min(params.train, params.val) < 0 or params.train + params.val == 0 or min(counts) < 1:
        raise ValueError("interaction_plan: expected numbers of sequences of 0 or more, one at least, and one instance and one "
                         f"subject of each split at least, got {params}")
    first = params.train_subjects + 1
    return (*interaction_specs("train", params.train, params.train_instances, range(1, first), params.seed),
            *interaction_specs("val", params.val, params.val_instances, range(first, first + params.val_subjects), params.seed))
