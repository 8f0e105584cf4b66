"""Seed and counts -> the rooms of the training stills.

Reads   nothing
Writes  StillSpec of every training and validation room
Method  one participant for the training split and one for the validation split, each with its own stream of seeds
Fails   when there is no training room
Paper   no paper; docs/synthetic/stills.md lists what the benchmark holds out
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.scene import StillSpec

LIBRARIES = ("numpy",)
THREADS = 1
MEMORY_GIB = 0.2


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    seed: int = 1
    """seed of the training stills; each room draws its own from it"""
    rooms: int = 54
    """training rooms, each with its own objects; about 60 samples each"""
    val_rooms: int = 5
    """rooms of the validation split"""
    layouts: int = 6
    """random layouts of the objects of a room"""
    views: int = 2
    """images of each layout"""
    tasks: int = 6
    """maximum number of tasks of one image"""


def run(params: Params) -> tuple[StillSpec, ...]:
    """Return the rooms of the training set."""
    from afford.synthetic.splits import RoomExtent, train_specs

    if params.rooms < 1:
        raise ValueError(f"train_plan.rooms: expected 1 or more, got {params.rooms}")
    return train_specs(params.seed, params.rooms, params.val_rooms, RoomExtent(params.layouts, params.views, params.tasks))
