"""Spec of a household body -> a closed mesh, and the part of every face.

Reads   ObjectSpec: category, seed, look
Writes  PartedMesh: ObjectMesh (metres, z up, standing or lying on z = 0) and MeshParts
Method  as object_build; open vessels have walls, closed ones are their outside
Fails   when the category is unknown, or the parts of a shape do not form one body
Paper   stands in for AffordDex's object meshes where they are absent
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.mesh import ObjectSpec, PartedMesh

LIBRARIES = ("numpy", "scipy", "numba", "manifold3d", "opencv-python-headless")
THREADS = 1
MEMORY_GIB = 0.5


@dataclass(frozen=True)
class Params:
    """Parameters of `household_build`."""

    edge_m: float = 0.006
    """longest edge; a body that would need more than max_faces gets longer ones"""
    max_faces: int = 16_000
    """maximum number of faces"""


def run(spec: ObjectSpec, params: Params) -> PartedMesh:
    """Build the body."""
    from afford.synthetic.objects.household_bodies import build_body

    return build_body(spec, params.edge_m, params.max_faces)
