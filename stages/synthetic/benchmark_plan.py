"""a seed and numbers -> the rooms of which the synthetic benchmark is rendered.

Reads   nothing
Writes  StillSpec of every room of the benchmark
Method  kitchens with known kinds of things, kitchens with new kinds and new uses, workshops and desks; each row is a
        participant with a stream of seeds of its own
Fails   never
Paper   takes the place of ActAffordance; docs/synthetic/stills.md says what training never sees
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.scene import StillSpec

LIBRARIES = ("numpy",)
THREADS = 1
MEMORY_GIB = 0.2


@dataclass(frozen=True)
class Params:
    seed: int = 20262
    """seed of the benchmark"""
    rooms: int = 32
    """rooms altogether; about 13 stills each"""
    layouts: int = 5
    """how often the things of a room are laid out anew"""
    views: int = 1
    """pictures of each layout"""
    tasks: int = 6
    """most tasks asked of one picture"""


def run(params: Params) -> tuple[StillSpec, ...]:
    """The rooms of the benchmark."""
    from afford.synthetic.splits import RoomExtent, benchmark_specs

    return benchmark_specs(params.seed, params.rooms, RoomExtent(params.layouts, params.views, params.tasks))
