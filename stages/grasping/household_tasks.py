"""Mesh of a household body and its parts -> the tasks that a hand can do with it, upright, flat and dropped.

Reads   HandModel; ObjectMesh and MeshParts of household_build
Writes  BodyTasks: GraspTasks `object/pose/use` with true N_t, each with its body as it rests; a sentence for each refused one
Method  bodies, uses and places as body_tasks, with the true parts; of the positive parts, the one with the best place is held. A
        standing body is upright as it was built, flat on its side; a tool is flat as it was built; both are dropped once, at random
Fails   ValueError for a category that is not in the lexicon, or numbers out of range
Paper   AffordDex grasps objects of UniDexGrasp in the poses in which they fall; uses and families are ours
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.bodies import BodyTasks
from schemas.hand import HandModel
from schemas.mesh import MeshParts, ObjectMesh

LIBRARIES = ("numpy", "scipy", "trimesh", "embreex", "mujoco", "pybullet", "numba", "manifold3d")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of `household_tasks`."""

    poses: tuple[str, ...] = ("upright", "flat", "dropped")
    """poses in which each use is tried"""
    uses: int = 3
    """uses of the lexicon that are tried, the first ones"""
    density_kg_m3: float = 700.0
    """density of bodies without walls (afford/grasping/sim/walls.py)"""
    tolerance_m: float = 0.002
    """largest distance of a hull from the surface of its piece (95th percentile)"""
    hulls: int = 24
    """hulls of a body, at most"""
    hull_corners: int = 64
    """corners of a hull, at most"""
    points: int = 1024
    """number of points on the surface"""
    seed: int = 0
    """seed of the points and drops"""
    least_fit: float = 0.02
    """tasks whose best place has less fit (0..1) are refused"""
    turns: int = 6
    """rotations that are tried, best first"""


def run(hand: HandModel, mesh: ObjectMesh, parts: MeshParts, params: Params) -> BodyTasks:
    """Derive the tasks of one body."""
    from afford.grasping.env.body_tasks import BodySettings
    from afford.grasping.env.household_tasks import household_tasks
    from afford.synthetic.objects.household_bodies import STANDING

    low = [name for name in ("uses", "density_kg_m3", "tolerance_m", "hulls", "points", "turns") if getattr(params, name) <= 0]
    if low or params.hull_corners < 8:
        name = low[0] if low else "hull_corners"
        raise ValueError(f"household_tasks.{name}: expected {'above 0' if low else '8 or more'}, got {getattr(params, name)}")
    settings = BodySettings(params.density_kg_m3, params.tolerance_m, params.hulls, params.hull_corners, params.points, params.seed,
                            params.least_fit, float("inf"), params.turns, walls=True, by_part=True)
    return household_tasks(hand, mesh, parts, mesh.category in STANDING, params.poses, params.uses, settings)
