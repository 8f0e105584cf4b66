"""a mesh and its parts -> a rigid body for grasping: convex hulls of named parts, mass, inertia, surface points.

Reads   ObjectMesh, MeshParts (of the object library, of a file, or of negative affordances)
Writes  GraspObject: hulls with their parts, mass and inertia of the closed mesh, even points with normals and parts
Method  each part is cut by planes until its pieces are convex to a tolerance; exact mass properties at one density;
        farthest-point samples. Deterministic.
Fails   when the mesh has no faces or no volume, or more parts than `hulls`
Paper   AffordDex uses UniDexGrasp's decomposed meshes (CoACD); here hulls keep their parts, so that a touched part is known
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
    """Parameters of object_solids."""

    density_kg_m3: float = 700.0
    """density of every object, between wood, hollow plastic and steel; a hammer weighs 0.12 kg"""
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


def run(mesh: ObjectMesh, parts: MeshParts, params: Params) -> GraspObject:
    """Build the rigid body."""
    from afford.grasping.sim.grasp_object import grasp_object

    low = [name for name in ("density_kg_m3", "tolerance_m", "hulls", "points") if getattr(params, name) <= 0]
    if low or params.hull_corners < 8:
        name = low[0] if low else "hull_corners"
        raise ValueError(f"object_solids.{name}: expected {'above 0' if low else '8 or more'}, got {getattr(params, name)}")
    return grasp_object(mesh, parts, params.density_kg_m3, params.tolerance_m, params.hulls, params.hull_corners, params.points,
                        params.seed)
