"""an object spec -> a closed textured mesh, and the part that every face belongs to.

Reads   ObjectSpec: category, seed, look
Writes  PartedMesh: ObjectMesh (metres, z up, standing or lying on z = 0) and MeshParts
Method  closed parametric solids of named parts, joined by an exact boolean union that remembers where every face came from;
        edges split to a length; materials over regions that know nothing of the parts. Deterministic.
Fails   when the category or the look is unknown, or the parts of a shape do not make one body
Paper   takes the place of AffordDex's object meshes (with the texture that it gets from TexPainter) where they are absent
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mesh import ObjectSpec, PartedMesh

LIBRARIES = ("numpy", "scipy", "numba", "manifold3d", "opencv-python-headless")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    edge_m: float = 0.006
    """longest edge; an object that would need more than max_faces gets a longer one"""
    max_faces: int = 16_000
    """most faces, before they are cut where a material ends (up to a fifth more)"""
    atlas_px: int = 512
    """side of the texture image, a power of two"""


def run(spec: ObjectSpec, params: Params) -> PartedMesh:
    """Build the object."""
    from afford.synthetic.objects.library import build_object

    return build_object(spec, params.edge_m, params.max_faces, params.atlas_px)
