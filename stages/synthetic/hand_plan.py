"""Seed and counts -> the rooms of the labelled images that the hand finder is trained on.

Reads   nothing
Writes  HandRoom of every room; the splits train and val
Method  kitchens, workshops and desks in turn; each split has its own stream of seeds
Fails   when a split would have no room
Paper   stands in for annotated hands (VISOR) where a video has none; no paper
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.scene import HandRoom

LIBRARIES = ("numpy",)
THREADS = 1
MEMORY_GIB = 0.2


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    rooms: int = 96
    """training rooms"""
    val_rooms: int = 4
    """validation rooms"""
    seed: int = 20265
    """seed of all rooms; each draws its own from it"""


def run(params: Params) -> tuple[HandRoom, ...]:
    """Return the rooms of both splits."""
    from afford.synthetic.splits import hand_rooms

    if min(params.rooms, params.val_rooms) < 1:
        raise ValueError(f"hand_plan: expected at least one training and one validation room, got {params.rooms} and "
                         f"{params.val_rooms}")
    return (*hand_rooms("train", params.rooms, params.seed), *hand_rooms("val", params.val_rooms, params.seed))
