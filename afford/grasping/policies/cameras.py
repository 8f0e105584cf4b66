"""Depth cameras around the table: how far hand and object are from each pixel, and which of the two it shows.

Cameras stand as in the paper and look at a point 15 cm above the table; it does not say how wide they see.
The table itself is not drawn: it is flat, below everything, and cut off by the box that clouds are cropped to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from afford.grasping.policies.shapes import BodyShape, HandShape
from afford.render.camera import facing
from afford.render.raster import edges, fill, project
from afford.render.scene import Camera

PLACES_M = ((0.0, 0.0, 0.55), (0.5, 0.0, 0.15), (0.0, 0.5, 0.15), (-0.5, 0.0, 0.15), (0.0, -0.5, 0.15))
"""from the middle of the table's top: above, and from four sides"""
LOOK_M = (0.0, 0.0, 0.15)
"""where they look"""
NOTHING, HAND, OBJECT = 0, 1, 2


@dataclass(frozen=True)
class Rig:
    """Which cameras, and how fine. ValueError for what cannot be."""

    views: int = 2
    """the first so many of PLACES_M"""
    size_px: int = 96
    """width and height of a picture"""
    view_deg: float = 60.0
    """angle that a picture spans"""

    def __post_init__(self) -> None:
        if not 1 <= self.views <= len(PLACES_M) or self.size_px < 1 or not 0 < self.view_deg < 180:
            raise ValueError(f"Rig: expected 1 to {len(PLACES_M)} views of a pixel or more that span 0 to 180 degrees, got {self}")

    def cameras(self) -> tuple[Camera, ...]:
        """As many as there are views."""
        focal = self.size_px / 2 / np.tan(np.radians(self.view_deg) / 2)
        middle = (self.size_px - 1) / 2
        K = np.array([[focal, 0, middle], [0, focal, middle], [0, 0, 1.0]])
        return tuple(Camera(K, _looking(np.array(place)), self.size_px, self.size_px) for place in PLACES_M[: self.views])


PAPER = Rig(5, 256)
"""as AffordDex has it"""


@dataclass(frozen=True, eq=False)
class Images:
    """What c cameras show of n worlds."""

    depth_m: np.ndarray
    """(n, c, h, w) float32 along the axis of the camera; 0 where nothing is seen"""
    kind: np.ndarray
    """(n, c, h, w) uint8 NOTHING, HAND or OBJECT"""


def shoot(cameras: Sequence[Camera], hand: HandShape, bodies: Sequence[BodyShape], q: np.ndarray, body: np.ndarray) -> Images:
    """Pictures of n worlds whose joints are q (n, d) and whose objects lie at poses (n, 7)."""
    shape = (len(q), len(cameras), cameras[0].height, cameras[0].width)
    near, seen = np.zeros(shape, np.float32), np.full(shape, -1, np.int32)
    for k, (fingers, thing) in enumerate(zip(hand.at(q), bodies, strict=True)):
        corners = np.concatenate([fingers, thing.at(body[k])])
        faces = np.concatenate([hand.faces, thing.faces + np.int32(len(fingers))])
        for view, camera in enumerate(cameras):
            E, bounds = edges(project(corners, camera), faces, camera.width, camera.height)
            fill(E, bounds, 0, len(faces), 1, near[k, view], seen[k, view])
    kind = np.where(seen < 0, NOTHING, np.where(seen < len(hand.faces), HAND, OBJECT)).astype(np.uint8)
    return Images(np.divide(1.0, near, out=np.zeros_like(near), where=near > 0), kind)


def spots(cameras: Sequence[Camera], depth_m: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """(k, 3) places in the world of `pixels` (k,), counted through the pictures depth_m (c, h, w) of one world."""
    view, y, x = np.unravel_index(pixels, depth_m.shape)
    turn = np.stack([camera.T_world_cam[:3, :3] @ np.linalg.inv(camera.K) for camera in cameras])
    eye = np.stack([camera.T_world_cam[:3, 3] for camera in cameras])
    rays = np.stack([x, y, np.ones_like(x)], axis=1).astype(np.float64)
    found: np.ndarray = eye[view] + (turn[view] @ rays[:, :, None])[:, :, 0] * depth_m.reshape(-1)[pixels, None]
    return found


def _looking(place: np.ndarray) -> np.ndarray:
    """(4, 4) T_world_cam of a camera at a place (3,)."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = facing(np.array(LOOK_M) - place), place
    return T
