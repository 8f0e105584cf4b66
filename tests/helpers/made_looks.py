"""Looks of a depth camera at simple things, by ray casting: exact depth and exact masks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import trimesh

from afford.render.camera import intrinsics, look_at
from afford.render.views.surface import Rays
from schemas.grasp import GraspScene

WIDTH, HEIGHT, LENGTH_M, RADIUS_M = 240, 160, 0.22, 0.012
Where = Callable[[np.ndarray], np.ndarray]
"""places on the rod (..., 3) -> bool (...,)"""


def nothing(place: np.ndarray) -> np.ndarray:
    return np.zeros(place.shape[:-1], bool)


def rod(left: Where = nothing, right: Where = nothing, negative: Where = nothing, yaw_rad: float = 0.0, table: bool = True,
        noise_m: float = 0.0) -> tuple[GraspScene, np.ndarray]:  # fmt: skip
    """Render a rod along x on a table, from the front and above, and return T_world_cam (4, 4) as well.

    Regions are functions of places in the rod's frame; hands with a region are in use.
    """
    bar = trimesh.creation.cylinder(RADIUS_M, LENGTH_M, sections=32)
    turn = trimesh.transformations.rotation_matrix(yaw_rad, [0, 0, 1])
    bar.apply_transform(turn @ trimesh.transformations.translation_matrix([0, 0, RADIUS_M])
                        @ trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))  # fmt: skip
    top = trimesh.creation.box((1.0, 1.0, 0.02)).apply_translation((0, 0, -0.01))
    whole = trimesh.util.concatenate([bar, top]) if table else bar
    T, K = look_at(np.array([0.0, -0.35, 0.45]), np.zeros(3)), intrinsics(WIDTH, HEIGHT, 45.0)
    depth, face = seen(whole, T, K)
    place = T[:3, 3] + _rays(K) * depth[..., None] @ T[:3, :3].T
    own = place @ turn[:3, :3]
    on = (face >= 0) & (face < len(bar.faces))
    region = np.stack([on & left(own), on & right(own)])
    noisy = depth + np.where(depth > 0, np.random.default_rng(0).normal(0.0, noise_m, depth.shape), 0.0)
    return GraspScene("rod", noisy.astype(np.float32), np.full((*depth.shape, 3), 128, np.uint8), K, region, region.any((1, 2)),
                      on & negative(own), np.zeros((0, 3))), T  # fmt: skip


def seen(mesh: trimesh.Trimesh, T: np.ndarray, K: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(h, w) exact depth, 0 where nothing is, and the face behind each pixel, -1 for none."""
    rays = _rays(K)
    way = (rays @ T[:3, :3].T).reshape(-1, 3)
    face = Rays(mesh.vertices, mesh.faces).first(np.tile(T[:3, 3], (len(way), 1)), way)
    corner, normal = mesh.vertices[mesh.faces[face][:, 0]], mesh.face_normals[face]
    hit = face >= 0
    depth = np.zeros(len(face))
    depth[hit] = (((corner - T[:3, 3]) * normal).sum(1)[hit]) / (way * normal).sum(1)[hit]
    return depth.reshape(rays.shape[:2]), face.reshape(rays.shape[:2])


def _rays(K: np.ndarray) -> np.ndarray:
    y, x = np.indices((HEIGHT, WIDTH), dtype=np.float64)
    return np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones_like(x)], axis=-1)
