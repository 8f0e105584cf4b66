"""Object spec -> a closed textured mesh, and the part of every face.

Reads   ObjectSpec: category, seed, look
Writes  PartedMesh: ObjectMesh (metres, z up, standing or lying on z = 0) and MeshParts
Method  closed parametric solids of named parts, joined by an exact boolean union that keeps the origin of every face; edges
        split to a length; materials over regions that are independent of the parts. Deterministic.
Fails   when the category or the look is unknown, or the parts of a shape do not form one body
Paper   stands in for AffordDex's object meshes (with textures from TexPainter) where they are absent
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mesh import ObjectSpec, PartedMesh

LIBRARIES = ("numpy", "scipy", "numba", "manifold3d", "opencv-python-headless")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of the stage."""

    edge_m: float = 0.006
    """longest edge; an object that would need more than max_faces gets longer ones"""
    max_faces: int = 16_000
    """maximum number of faces before the cuts at material boundaries (up to a fifth more)"""
    atlas_px: int = 512
    """side of the texture image, a power of two"""


def run(spec: ObjectSpec, params: Params) -> PartedMesh:
    """Build the object."""
    from afford.synthetic.objects.library import build_object

    return build_object(spec, params.edge_m, params.max_faces, params.atlas_px)
