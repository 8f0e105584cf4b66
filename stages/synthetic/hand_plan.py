"""a seed and numbers -> the rooms in which hands are rendered for the finder of hands to learn from.

Reads   nothing
Writes  HandRoom of every room; the splits train and val
Method  kitchens, workshops and desks by turns; every split has a stream of seeds of its own
Fails   when a split would have no room
Paper   takes the place of annotated hands (VISOR) where a video has none; no paper
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.scene import HandRoom

LIBRARIES = ("numpy",)
THREADS = 1
MEMORY_GIB = 0.2


@dataclass(frozen=True)
class Params:
    rooms: int = 96
    """rooms to learn from"""
    val_rooms: int = 4
    """rooms that judge"""
    seed: int = 20265
    """seed of all rooms; each draws its own from it"""


def run(params: Params) -> tuple[HandRoom, ...]:
    """The rooms of both splits."""
    from afford.synthetic.splits import hand_rooms

    if min(params.rooms, params.val_rooms) < 1:
        raise ValueError(f"hand_plan: expected rooms to learn from and rooms that judge, got {params.rooms} and {params.val_rooms}")
    return (*hand_rooms("train", params.rooms, params.seed), *hand_rooms("val", params.val_rooms, params.seed))
