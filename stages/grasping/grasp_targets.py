"""a body that lies on the table, a hand -> places along it where a person could grasp it.

Reads   GraspObject; HandModel (the world that it comes to rest in has one, out of the way)
Writes  GraspTarget of each place: pose of the object, handle across which it is grasped, how thick it is there
Method  the object lies as it was built; places are even along its long axis about the centre of mass, kept off the ends, and know
        nothing of parts; every second one has the object turned round. Thickness is that of the surface within 2.5 cm
Fails   ValueError, one sentence: a parameter out of range, an object that rolls on
Paper   AffordDex, HTI, takes clips of OakInk2, whose people grasp where they like; here places are uniform
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.grasp import GraspObject
from schemas.hand import GraspTarget, HandModel

LIBRARIES = ("numpy", "scipy", "trimesh", "mujoco", "pybullet")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    places: int = 4
    """along the object"""
    reach_m: float = 0.06
    """how far from the centre of mass they are at most"""
    thick_m: tuple[float, float] = (0.009, 0.09)
    """what is thinner or thicker is taken for that: a hand closes no further, and opens no wider"""
    engine: str = "mujoco"
    """in which the object comes to rest: mujoco or bullet"""
    seed: int = 0
    """of the places"""


def run(body: GraspObject, hand: HandModel, params: Params) -> tuple[GraspTarget, ...]:
    """All places of one object."""
    from afford.grasping.env.task import grasp_targets

    low, high = params.thick_m
    if params.places < 1 or not params.reach_m >= 0 or not 0 < low <= high:
        raise ValueError(f"grasp_targets: expected places of 1 or more, reach_m of 0 or more and two rising thick_m above 0, got "
                         f"{params.places}, {params.reach_m} and {params.thick_m}")
    return tuple(grasp_targets(hand, body, params.engine, params.places, params.reach_m, params.thick_m, params.seed))
