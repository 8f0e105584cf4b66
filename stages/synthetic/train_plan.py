"""a seed and numbers -> the rooms of which training stills are rendered.

Reads   nothing
Writes  StillSpec of every training and validation room
Method  a participant of the training split and one of the validation split, each with a stream of seeds of its own
Fails   when there is no room to train on
Paper   no paper; docs/synthetic/stills.md says what the benchmark holds out
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.scene import StillSpec

LIBRARIES = ("numpy",)
THREADS = 1
MEMORY_GIB = 0.2


@dataclass(frozen=True)
class Params:
    seed: int = 1
    """seed of the training stills; each room draws its own from it"""
    rooms: int = 54
    """training rooms, each with things of its own; about 60 samples each"""
    val_rooms: int = 5
    """rooms of the validation split"""
    layouts: int = 6
    """how often the things of a room are laid out anew"""
    views: int = 2
    """pictures of each layout"""
    tasks: int = 6
    """most tasks asked of one picture"""


def run(params: Params) -> tuple[StillSpec, ...]:
    """The rooms of the training set."""
    from afford.synthetic.splits import RoomExtent, train_specs

    if params.rooms < 1:
        raise ValueError(f"train_plan.rooms: expected 1 or more, got {params.rooms}")
    return train_specs(params.seed, params.rooms, params.val_rooms, RoomExtent(params.layouts, params.views, params.tasks))
