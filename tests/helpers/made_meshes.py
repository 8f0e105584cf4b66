"""Meshes whose surfaces are known in closed form."""

from __future__ import annotations

import numpy as np
import trimesh

from schemas.mesh import ObjectMesh


def as_object(shape: trimesh.Trimesh, name: str = "thing") -> ObjectMesh:
    """Convert a trimesh to an ObjectMesh in one light colour."""
    vertices, faces = np.asarray(shape.vertices, np.float32), np.asarray(shape.faces, np.int32)
    return ObjectMesh(name, "", vertices, faces, np.zeros((len(faces), 3, 2), np.float32), np.full((1, 1, 3), 200, np.uint8))


def ball(radius_m: float = 0.1, cuts: int = 4) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(cuts, radius_m)


def ring() -> trimesh.Trimesh:
    """Build a lying torus of 6 and 2 cm."""
    return trimesh.creation.torus(0.06, 0.02)


def slotted() -> trimesh.Trimesh:
    """Build a box of 10 cm with a slot, 2 cm wide and 7 cm deep, open at the top and at both ends in y."""
    slot = trimesh.creation.box((0.02, 0.2, 0.12), transform=trimesh.transformations.translation_matrix((0, 0, 0.04)))
    return cut_up(trimesh.boolean.difference([trimesh.creation.box((0.1, 0.1, 0.1)), slot]))


def cup() -> trimesh.Trimesh:
    """Build a cylinder of 8 by 10 cm, hollow from above."""
    hollow = trimesh.creation.cylinder(0.036, 0.1, sections=48, transform=trimesh.transformations.translation_matrix((0, 0, 0.005)))
    return cut_up(trimesh.boolean.difference([trimesh.creation.cylinder(0.04, 0.1, sections=48), hollow]))


def shell() -> trimesh.Trimesh:
    """Build a ball with a hidden one inside; 80 % of the area is outside."""
    return trimesh.util.concatenate([ball(), ball(0.05)])


def cut_up(shape: trimesh.Trimesh, edge_m: float = 0.012) -> trimesh.Trimesh:
    """Subdivide to edges of at most so many metres."""
    return trimesh.Trimesh(*trimesh.remesh.subdivide_to_size(shape.vertices, shape.faces, edge_m, 12))
