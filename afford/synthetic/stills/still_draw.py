"""A layout seen by a camera: its picture, the complete mask of every thing, and the visible mask of a hand put into it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from afford.render.camera import intrinsics, look_at
from afford.render.draw import draw_ids, render
from afford.render.model import Camera, Instance
from afford.render.raster import edges, fill, project
from afford.synthetic.kitchens.render_clip import grain
from afford.synthetic.kitchens.scene_builder import CENTRE
from afford.synthetic.kitchens.world import EYE
from afford.synthetic.stills.still_ways import Way
from afford.synthetic.stills.still_world import Layout, StillWorld

EYE_SPREAD_M = np.array([0.07, 0.05, 0.06])
GAZE_SPREAD_M = np.array([0.05, 0.04, 0.02])
FIELD_OF_VIEW_DEG = (52.0, 60.0)
ROLL_RAD = 0.06


@dataclass(frozen=True)
class Sizes:
    """Width and height of the picture and of its masks, px; both show the same."""

    image: tuple[int, int]
    mask: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Shot:
    """One picture and what is needed to put masks on it."""

    rgb: np.ndarray
    """(h, w, 3) uint8 without hands"""
    camera: Camera
    """camera of the masks"""
    ids: np.ndarray
    """(mask h, mask w) int16 number of the thing seen, -1 elsewhere"""
    nearness: np.ndarray
    """(mask h, mask w) float32 1 / depth of what is seen, 0 for nothing"""

    def complete(self, instances: Sequence[Instance]) -> np.ndarray:
        """(h, w) bool: all pixels of these, whatever stands before them."""
        return _drawn(instances, self.camera, np.zeros_like(self.nearness))[1]

    def hands(self, world: StillWorld, ways: tuple[Way | None, Way | None]) -> np.ndarray:
        """(2, h, w) bool: visible pixels of the (left, right) hand, arm and sleeve, as it takes hold."""
        out, near = np.zeros((2, *self.nearness.shape), np.bool_), self.nearness
        for side, way in enumerate(ways):
            if way is not None:
                near, out[side] = _drawn(world.hand(way), self.camera, near)
                out[:side] &= ~out[side]
        return out


def shoot(world: StillWorld, layout: Layout, sizes: Sizes, supersample: int) -> Shot:
    """Take a picture of a layout with a head that looks at the table from somewhere else each time."""
    rng = world.rng
    eye = EYE + rng.uniform(-1, 1, 3) * EYE_SPREAD_M
    gaze = np.array([*CENTRE, 0.04]) + rng.uniform(-1, 1, 3) * GAZE_SPREAD_M
    T, view_deg = look_at(eye, gaze, float(rng.uniform(-ROLL_RAD, ROLL_RAD))), float(rng.uniform(*FIELD_OF_VIEW_DEG))
    seen = render(layout.instances, _camera(T, sizes.image, view_deg), layout.light, world.textures, supersample=supersample)
    camera = _camera(T, sizes.mask, view_deg)
    same = sizes.mask == sizes.image
    ids, depth = (seen.ids, seen.depth_m) if same else draw_ids(layout.instances, camera, world.textures)
    nearness = np.where(depth > 0, 1.0 / np.maximum(depth, 1e-9), 0.0).astype(np.float32)
    return Shot(grain(seen.rgb, rng), camera, ids, nearness)


def _camera(T_world_cam: np.ndarray, size: tuple[int, int], view_deg: float) -> Camera:
    return Camera(intrinsics(*size, view_deg), T_world_cam, *size)


def _drawn(instances: Sequence[Instance], camera: Camera, nearness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearness (h, w) with the instances drawn on top, and (h, w) bool where they are seen."""
    near, face = nearness.copy(), np.full(nearness.shape, -1, np.int32)
    for one in instances:
        points = one.vertices if one.vertices is not None else _moved(one)
        E, bounds = edges(project(points, camera), one.mesh.faces, camera.width, camera.height)
        fill(E, bounds, 0, len(one.mesh.faces), 1, near, face)
    return near, face >= 0


def _moved(instance: Instance) -> np.ndarray:
    T = instance.T_world_mesh.astype(np.float32)
    return np.asarray(instance.mesh.vertices @ T[:3, :3].T + T[:3, 3], np.float32)
