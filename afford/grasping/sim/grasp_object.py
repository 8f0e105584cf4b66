"""A mesh and its parts -> what physics and grasping need of it: hulls, mass, inertia, points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh

from afford.common.geometry import farthest_point_sampling, sample_surface
from afford.grasping.sim.hulls import corners, decomposed
from schemas.grasp import GraspObject
from schemas.mesh import MeshParts, ObjectMesh

UNNAMED = "unnamed"
SURPLUS = 4
"""points drawn for each that is kept, so that those kept are even"""


def grasp_object(mesh: ObjectMesh, parts: MeshParts, density_kg_m3: float, tolerance_m: float, hulls: int, hull_corners: int,
                 points: int, seed: int) -> GraspObject:  # fmt: skip
    """The object; ValueError when it has no faces, no volume, or more parts than hulls."""
    if not len(mesh.faces):
        raise ValueError(f"{mesh.name}: expected a mesh with faces, got none; read or build it again")
    vertices, names, part = mesh.vertices.astype(np.float64), *_named(parts)
    solid = trimesh.Trimesh(vertices, mesh.faces, process=False)
    pieces = decomposed(solid, part, tolerance_m, hulls)
    shapes = [corners(piece, hull_corners) for piece in pieces]
    mass, com, inertia = _mass([solid] if solid.is_volume else [trimesh.convex.convex_hull(s) for s in shapes], density_kg_m3)
    if not mass > 0:
        raise ValueError(f"{mesh.name}: expected a mesh with a volume, got {mass / density_kg_m3} m3; give it a thickness")
    place, face = _points(solid, points, seed)
    return GraspObject(
        name=mesh.name, category=mesh.category, parts=names, corners=np.concatenate(shapes),
        hull_start=np.cumsum([0, *map(len, shapes)]).astype(np.int32),
        hull_part=np.array([piece.part for piece in pieces], np.int16), mass_kg=mass, com_m=com, inertia_kgm2=inertia,
        closed=bool(solid.is_volume), points=place, normals=solid.face_normals[face].astype(np.float32),
        point_part=part[face].astype(np.int16), size_m=np.ptp(vertices, axis=0),
        stand_out_m=np.array([piece.stand_out_m for piece in pieces]))  # fmt: skip


def _named(parts: MeshParts) -> tuple[tuple[str, ...], np.ndarray]:
    """Names, and the index of each face's; faces without one are a part of their own."""
    if (parts.part >= 0).all():
        return parts.names, parts.part
    return (*parts.names, UNNAMED), np.where(parts.part < 0, len(parts.names), parts.part)


def _mass(solids: Sequence[trimesh.Trimesh], density_kg_m3: float) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, its centre and the inertia about it, of several closed bodies together."""
    mass = np.array([body.volume * density_kg_m3 for body in solids])
    centres = np.array([body.center_mass for body in solids])
    com = mass @ centres / max(mass.sum(), 1e-30)
    arms = centres - com
    steiner = np.einsum("k,kij->ij", mass, np.eye(3) * (arms**2).sum(1)[:, None, None] - arms[:, :, None] * arms[:, None])
    inertia = sum((body.moment_inertia * density_kg_m3 for body in solids), np.zeros((3, 3))) + steiner
    return float(mass.sum()), com, 0.5 * (inertia + inertia.T)


def _points(solid: trimesh.Trimesh, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    drawn, face = sample_surface(solid.vertices, solid.faces, solid.area_faces, SURPLUS * count, np.random.default_rng(seed))
    kept = farthest_point_sampling(drawn, count)
    return drawn[kept], face[kept]
