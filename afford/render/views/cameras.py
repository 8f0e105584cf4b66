"""Where cameras stand around an object: the six cardinal ones, or anywhere on a sphere.

Object frame: z up; a camera named front looks along +y, as a person stands who faces the object (docs/conventions.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.render.model import Camera

CARDINAL = {"front": (0, -1, 0), "back": (0, 1, 0), "left": (-1, 0, 0), "right": (1, 0, 0), "top": (0, 0, 1), "bottom": (0, 0, -1)}
"""where each of the paper's six cameras stands, seen from the middle of the object"""
FILLED = 0.92
"""share of a picture's side that the object fills"""


@dataclass(frozen=True)
class Sphere:
    """The sphere around an object: centre (3,) and radius, metres."""

    centre: np.ndarray
    radius_m: float

    @staticmethod
    def of(vertices: np.ndarray) -> Sphere:
        """Around the middle of the bounding box."""
        centre = (vertices.min(0).astype(np.float64) + vertices.max(0)) / 2
        return Sphere(centre, max(float(np.linalg.norm(vertices - centre, axis=1).max()), 1e-6))

    def eye(self, towards: np.ndarray, distance: float) -> np.ndarray:
        """(..., 3) metres: camera centres `distance` radii away in the directions (..., 3)."""
        unit = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
        return np.asarray(self.centre + distance * self.radius_m * unit)


def camera(vertices: np.ndarray, around: Sphere, towards: np.ndarray, distance: float, size_px: int) -> Camera:
    """A square picture from `distance` radii away in the direction `towards` (3,), zoomed so that the object (v, 3) fills it."""
    if distance <= 1:
        raise ValueError(f"distance: expected more than 1 radius, so that the camera is outside, got {distance}")
    way = np.asarray(towards, np.float64)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = facing(-way), around.eye(way, distance)
    seen = (vertices - T[:3, 3]) @ T[:3, :3]
    flat = seen[:, :2] / seen[:, 2:]
    low, high = flat.min(0), flat.max(0)
    focal = FILLED * size_px / max(float((high - low).max()), 1e-9)
    middle = (size_px - 1) / 2 - focal * (low + high) / 2
    return Camera(np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1.0]]), T, size_px, size_px)


def facing(forward: np.ndarray) -> np.ndarray:
    """(3, 3) camera axes in the object frame: z along `forward`, y as far down as it can be; from above and below, y towards -y."""
    z = forward / np.linalg.norm(forward)
    down = np.array([0, 0, -1.0]) if abs(z[2]) < 0.999 else np.array([0, -1.0, 0])
    x = np.cross(down, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
