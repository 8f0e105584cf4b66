"""Seed and counts -> the rooms of the synthetic benchmark.

Reads   nothing
Writes  StillSpec of every room of the benchmark
Method  kitchens with known kinds of objects, kitchens with held-out kinds and uses, workshops and desks; each row is a
        participant with its own stream of seeds
Fails   never
Paper   stands in for ActAffordance; docs/synthetic/stills.md lists what training never sees
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

    seed: int = 20262
    """seed of the benchmark"""
    rooms: int = 32
    """total number of rooms; about 13 stills each"""
    layouts: int = 5
    """random layouts of the objects of a room"""
    views: int = 1
    """images of each layout"""
    tasks: int = 6
    """maximum number of tasks of one image"""


def run(params: Params) -> tuple[StillSpec, ...]:
    """Return the rooms of the benchmark."""
    from afford.synthetic.splits import RoomExtent, benchmark_specs

    return benchmark_specs(params.seed, params.rooms, RoomExtent(params.layouts, params.views, params.tasks))
