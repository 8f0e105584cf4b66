"""The rooms of the training stills -> these, and validation rooms of settings that training does not show.

Reads   StillSpec of every training and validation room
Writes  the same, then StillSpec of every other room, split val
Method  workshops and desks, each setting with its own stream of seeds. Step, threshold and calibration of a model are chosen on
        what it has not learned, as its users' pictures are
Fails   never; without rooms the validation has kitchens alone
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
    """Parameters of the stage; layouts, views and tasks as in train_plan."""

    seed: int = 1
    """seed of the stills; each room draws its own from it"""
    rooms: int = 2
    """rooms of each setting"""
    layouts: int = 6
    """random layouts of the objects of a room"""
    views: int = 2
    """images of each layout"""
    tasks: int = 6
    """maximum number of tasks of one image"""


def run(rooms: tuple[StillSpec, ...], params: Params) -> tuple[StillSpec, ...]:
    """Return the rooms, and those of all other settings."""
    from afford.synthetic.splits import RoomExtent, shift_specs

    return rooms + shift_specs(params.seed, params.rooms, RoomExtent(params.layouts, params.views, params.tasks))
