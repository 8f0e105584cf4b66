"""an object that lies on the table, a hand -> places along it where a person could grasp it.

Reads   GraspObject; HandModel (it is in the world in which the object comes to rest, out of the way)
Writes  GraspTarget of each place: pose of the object, handle across which it is grasped, thickness there
Method  the object lies as it was built; places are even along its long axis about the centre of mass, kept off the ends, and
        independent of parts; every second one has the object turned round. Thickness is that of the surface within 2.5 cm
Fails   ValueError: a parameter out of range, an object that does not stop rolling
Paper   AffordDex, HTI, takes clips of OakInk2, in which people choose the place; here places are uniform
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
    """Parameters of grasp_targets."""

    places: int = 4
    """number of places along the object"""
    reach_m: float = 0.06
    """largest distance of a place from the centre of mass"""
    thick_m: tuple[float, float] = (0.009, 0.09)
    """thickness is clipped to this range: a hand closes and opens no further"""
    engine: str = "mujoco"
    """engine in which the object comes to rest: mujoco or bullet"""
    seed: int = 0
    """seed of the places"""


def run(body: GraspObject, hand: HandModel, params: Params) -> tuple[GraspTarget, ...]:
    """Choose all places of one object."""
    from afford.grasping.env.task import grasp_targets

    low, high = params.thick_m
    if params.places < 1 or not params.reach_m >= 0 or not 0 < low <= high:
        raise ValueError(f"grasp_targets: expected places of 1 or more, reach_m of 0 or more and two rising thick_m above 0, got "
                         f"{params.places}, {params.reach_m} and {params.thick_m}")
    return tuple(grasp_targets(hand, body, params.engine, params.places, params.reach_m, params.thick_m, params.seed))
