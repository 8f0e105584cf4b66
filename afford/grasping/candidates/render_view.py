"""Render RGB-D views of an object on a table, for comparisons of grasps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from afford.render.camera import intrinsics, look_at
from afford.render.draw import render
from afford.render.materials import wood
from afford.render.mesh import has_area
from afford.render.raster import View, depth
from afford.render.scene import BACKGROUND, Camera, Instance, Light, Textures, batch
from afford.render.solids import patch
from afford.render.views.draw import drawable, material
from schemas.mesh import ObjectMesh

TABLE_M = 0.6
"""half the side of the table"""
LIGHT = Light(centre=(0.0, 0.0, 0.05), radius_m=0.5)


@dataclass(frozen=True)
class ViewCamera:
    """Camera of a view."""

    distance_m: float = 0.6
    """from the middle of the object"""
    down_deg: float = 55.0
    """downward pitch"""
    field_deg: float = 42.0
    """horizontal field of view"""
    width_px: int = 320
    height_px: int = 240
    noise_m: float = 0.002
    """standard deviation of depth noise"""


class DepthView(NamedTuple):
    """rgb (h, w, 3) uint8; depth_m (h, w) float32 with noise; face (h, w) int32 of the object, else -1; K; T_world_cam."""

    rgb: np.ndarray
    depth_m: np.ndarray
    face: np.ndarray
    K: np.ndarray
    T_world_cam: np.ndarray


def render_view(mesh: ObjectMesh, body: np.ndarray, view: ViewCamera, rng: np.random.Generator,
                supersample: int = 2) -> DepthView:  # fmt: skip
    """Render the object at the pose (7,) on a table z = 0 with a random wood texture, from the front and above."""
    T_world_obj = np.eye(4)
    T_world_obj[:3, :3], T_world_obj[:3, 3] = Rotation.from_quat(body[3:]).as_matrix(), body[:3]
    corners = mesh.vertices @ T_world_obj[:3, :3].T + T_world_obj[:3, 3]
    camera = _camera((corners.min(0) + corners.max(0)) / 2, view)
    thing = Instance(drawable(mesh), material(mesh.texture), T_world_obj, entity=0)
    instances = (thing, _table(rng))
    textures = Textures.of(one.material for one in instances)
    shown = render(instances, camera, LIGHT, textures, supersample=supersample)
    face = _faces(mesh, instances, textures, camera)
    noise = rng.normal(0.0, view.noise_m, shown.depth_m.shape) if view.noise_m else 0.0
    noisy = np.where(shown.depth_m > 0, shown.depth_m + noise, 0.0).astype(np.float32)
    return DepthView(shown.rgb, noisy, face, camera.K, camera.T_world_cam)


def _camera(target: np.ndarray, view: ViewCamera) -> Camera:
    down = np.radians(view.down_deg)
    place = target + view.distance_m * np.array([0.0, -np.cos(down), np.sin(down)])
    return Camera(intrinsics(view.width_px, view.height_px, view.field_deg), look_at(place, target), view.width_px, view.height_px)


def _table(rng: np.random.Generator) -> Instance:
    side = 2 * TABLE_M
    top = patch(np.array([-TABLE_M, -TABLE_M, 0.0]), np.array([side, 0, 0]), np.array([0, side, 0]), (1.5, 1.5))
    return Instance(top, wood(rng), entity=BACKGROUND, casts=False)


def _faces(mesh: ObjectMesh, instances: tuple[Instance, ...], textures: Textures, camera: Camera) -> np.ndarray:
    """Return the (h, w) int32 face of the mesh at each pixel centre, else -1; the renderer skips faces without area."""
    kept = np.flatnonzero(has_area(mesh.vertices, mesh.faces)).astype(np.int32)
    view = View.of(batch(instances, textures), camera)
    seen, near = view.seen(1)[1]
    mine = (seen >= 0) & (seen < len(kept)) & (depth(near) > 0)
    return np.where(mine, kept[np.where(mine, seen, 0)], np.int32(-1))
