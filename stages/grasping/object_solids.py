"""a mesh and its parts -> a rigid body that can be grasped: convex hulls of named parts, mass, inertia, surface points.

Reads   ObjectMesh, MeshParts (of the object library, of a file, or as negative affordances name them)
Writes  GraspObject: hulls with the part of each, mass and inertia of the closed mesh, even points with normals and parts
Method  each part is cut by planes until its pieces are convex to a tolerance; exact mass properties at one density;
        farthest-point samples. Deterministic.
Fails   when the mesh has no faces or no volume, or has more parts than hulls are allowed
Paper   AffordDex uses UniDexGrasp's decomposed meshes (CoACD); here parts survive, so that a touched part is known
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.grasp import GraspObject
from schemas.mesh import MeshParts, ObjectMesh

LIBRARIES = ("numpy", "scipy", "trimesh", "embreex")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    density_kg_m3: float = 700.0
    """of every object: between wood, hollow plastic and steel; a hammer weighs 0.12 kg"""
    tolerance_m: float = 0.002
    """a piece is convex enough when its hull stands out of the body by less (95th percentile)"""
    hulls: int = 24
    """most hulls of an object"""
    hull_corners: int = 64
    """most corners of a hull"""
    points: int = 1024
    """points on the surface"""
    seed: int = 0
    """seed of the points"""


def run(mesh: ObjectMesh, parts: MeshParts, params: Params) -> GraspObject:
    """Build the rigid body."""
    from afford.grasping.sim.grasp_object import grasp_object

    low = [name for name in ("density_kg_m3", "tolerance_m", "hulls", "points") if getattr(params, name) <= 0]
    if low or params.hull_corners < 8:
        name = low[0] if low else "hull_corners"
        raise ValueError(f"object_solids.{name}: expected {'above 0' if low else '8 or more'}, got {getattr(params, name)}")
    return grasp_object(mesh, parts, params.density_kg_m3, params.tolerance_m, params.hulls, params.hull_corners, params.points,
                        params.seed)
