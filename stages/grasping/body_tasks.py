"""a mesh of the user, its parts and its negative affordance -> the tasks that a hand can do with it, and reasons for the others.

Reads   HandModel; ObjectMesh, MeshParts and MeshReport; PartDescriptions and NegativeAffordances of the mesh; for an object of
        UniDexGrasp, the files of its grasps
Writes  BodyTasks: GraspTasks with predicted N_t, each with its body in the pose in which it is laid; refusals and assumptions, one
        sentence each
Method  convex pieces of the shape, mass by density (as object_solids), of vessels by their walls; each description is a use; the
        stable pose with the best place of a grasp family (afford/grasping/env/families.py) is taken, if the body rests there in
        MuJoCo; UniDexGrasp's objects are laid as their grasps are, where there are some
Fails   never for a bad mesh: it has no tasks and a reason; ValueError for numbers out of range
Paper   AffordDex grasps objects of UniDexGrasp in the poses in which they fall; the choice of the pose is ours
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

from schemas.bodies import BodyTasks
from schemas.files import FileTree
from schemas.hand import HandModel
from schemas.mesh import MeshParts, MeshReport, ObjectMesh
from schemas.surface import NegativeAffordances, PartDescriptions

LIBRARIES = ("numpy", "scipy", "trimesh", "embreex", "mujoco", "pybullet")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of body_tasks."""

    density_kg_m3: float = 700.0
    """density of every object; hollow things that are modelled as solid ones need less"""
    tolerance_m: float = 0.002
    """largest distance of a hull from the surface of its piece (95th percentile)"""
    hulls: int = 24
    """hulls of an object, at most"""
    hull_corners: int = 64
    """corners of a hull, at most"""
    points: int = 1024
    """number of points on the surface"""
    seed: int = 0
    """seed of the points"""
    least_fit: float = 0.02
    """uses whose best place has less fit (0..1) are refused"""
    most_kg: float = 3.0
    """heavier objects are refused"""
    turns: int = 6
    """stable poses that are tried, best first"""
    walls: bool = True
    """vessels of the lexicon (afford/grasping/sim/walls.py WALLS) are empty: their mass is that of their walls"""
    by_part: bool = False
    """cut a body into convex pieces within each part, for parts that are known and follow its shape; false: by its shape alone"""


def run(hand: HandModel, mesh: ObjectMesh, parts: MeshParts, report: MeshReport, descriptions: PartDescriptions,
        found: NegativeAffordances, params: Params, files: FileTree | None = None) -> BodyTasks:  # fmt: skip
    """Derive the tasks of one mesh; `files` are those of an object of UniDexGrasp, whose name ends in its size."""
    from afford.grasping.env.body_tasks import BodySettings, body_tasks
    from afford.grasping.env.listed_rests import listed_turns

    low = [name for name in ("density_kg_m3", "tolerance_m", "hulls", "points", "most_kg", "turns") if getattr(params, name) <= 0]
    if low or params.hull_corners < 8:
        name = low[0] if low else "hull_corners"
        raise ValueError(f"body_tasks.{name}: expected {'above 0' if low else '8 or more'}, got {getattr(params, name)}")
    listed = listed_turns(files, int(files.name[-3:]) / 100) if files else None
    return body_tasks(hand, mesh, parts, report, descriptions, found, BodySettings(**asdict(params)), listed)
