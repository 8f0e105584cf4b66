"""The rooms of the training stills -> these, and validation rooms of settings that training does not show.

Reads   StillSpec of every training and validation room
Writes  the same, then StillSpec of every other room, split val
Method  workshops and desks, each setting with its own stream of seeds. Step, threshold and calibration of a model are chosen on
        what it has not learned, as its users' pictures are
Fails   when the number of rooms is negative; with 0 the validation has kitchens alone
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
    """Parameters of the stage; rooms have as many layouts, views and tasks as those of train_plan."""

    seed: int = 1
    """seed of the stills; each room draws its own from it"""
    rooms: int = 2
    """rooms of each setting"""


def run(rooms: tuple[StillSpec, ...], params: Params) -> tuple[StillSpec, ...]:
    """Return the rooms, and those of all other settings."""
    from afford.synthetic.splits import RoomExtent, shift_specs

    if params.rooms < 0:
        raise ValueError(f"shift_plan.rooms: expected 0 or more, got {params.rooms}")
    return rooms + shift_specs(params.seed, params.rooms, RoomExtent(rooms[0].layouts, rooms[0].views, rooms[0].tasks))
