"""Pinhole cameras: look-at poses, a moving head-worn camera, and cameras around an object.

The head-worn camera follows gaze targets with a small random sway. Cameras around an object are the six cardinal ones of the paper,
or anywhere on a sphere. Object frame: z up; the camera `front` looks along +y, as a person who faces the object
(docs/conventions.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.render.motion import Pose, axis_angle, ease, pose, sway
from afford.render.scene import Camera


@dataclass(frozen=True)
class HeadStyle:
    """Amplitudes of the head motion."""

    sway_m: float
    """amplitude of the sway of the head position"""
    turn_deg: float
    """amplitude of the sway of the gaze direction"""
    roll_deg: float
    """amplitude of the roll"""
    orbit_m: float
    """sideways travel over the whole clip; larger values give more parallax"""


CALM = HeadStyle(sway_m=0.033, turn_deg=3.9, roll_deg=2.0, orbit_m=0.07)
PARALLAX = HeadStyle(sway_m=0.05, turn_deg=4.0, roll_deg=2.5, orbit_m=0.20)


def look_at(eye: np.ndarray, target: np.ndarray, roll_rad: float = 0.0) -> Pose:
    """Compute T_world_cam of a camera at `eye` (3,) that looks at `target` (3,).

    Metres; camera axes x right, y down, z forward; world z up.
    """
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    frame = np.stack([right, np.cross(forward, right), forward], 1)
    return pose(eye, frame @ axis_angle((0, 0, 1), roll_rad))


def intrinsics(width: int, height: int, field_of_view_deg: float) -> np.ndarray:
    """Compute K (3, 3) of a pinhole camera with square pixels from its horizontal field of view."""
    focal = 0.5 * width / np.tan(np.radians(field_of_view_deg) / 2)
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])


class Head:
    """Pose of a head-worn camera over time: gaze targets of the action, plus sway."""

    def __init__(self, rng: np.random.Generator, style: HeadStyle, eye: np.ndarray, length: float) -> None:
        self.style, self.eye, self.length = style, eye, length
        self.gazes: list[tuple[float, float, np.ndarray]] = []
        self._move = sway(rng, 3, (30, 74))
        self._turn = sway(rng, 3, (25, 64))
        self._side = 1.0 if rng.random() < 0.5 else -1.0

    def look(self, start: float, stop: float, target: np.ndarray) -> None:
        """Turn the gaze to `target` (3,) between two times."""
        self.gazes.append((start, stop, np.asarray(target, float)))

    def at(self, time: float) -> Pose:
        """Compute T_world_cam at a time."""
        style = self.style
        target = self.gazes[0][2]
        for start, stop, goal in self.gazes[1:]:
            target = target + (goal - target) * ease((time - start) / (stop - start))
        travel = self._side * style.orbit_m * np.sin(np.pi * (time / self.length - 0.5))
        eye = self.eye + style.sway_m * self._move(time) + (travel, 0, 0)
        wander = self._turn(time)
        reach = np.linalg.norm(target - eye) * np.tan(np.radians(style.turn_deg))
        aim = target + reach * np.array([wander[0], wander[1], 0])
        return look_at(eye, aim, np.radians(style.roll_deg) * wander[2])


CARDINAL = {"front": (0, -1, 0), "back": (0, 1, 0), "left": (-1, 0, 0), "right": (1, 0, 0), "top": (0, 0, 1), "bottom": (0, 0, -1)}
"""directions of the paper's six cameras from the centre of the object"""
FILLED = 0.92
"""share of an image's side that the object fills"""


@dataclass(frozen=True)
class Sphere:
    """Bounding sphere of an object: centre (3,) and radius, metres."""

    centre: np.ndarray
    radius_m: float

    @staticmethod
    def of(vertices: np.ndarray) -> Sphere:
        """Build the sphere around the centre of the bounding box."""
        centre = (vertices.min(0).astype(np.float64) + vertices.max(0)) / 2
        return Sphere(centre, max(float(np.linalg.norm(vertices - centre, axis=1).max()), 1e-6))

    def eye(self, towards: np.ndarray, distance: float) -> np.ndarray:
        """Compute camera centres (..., 3), metres, `distance` radii away in the directions (..., 3)."""
        unit = towards / np.linalg.norm(towards, axis=-1, keepdims=True)
        return np.asarray(self.centre + distance * self.radius_m * unit)


def camera(vertices: np.ndarray, around: Sphere, towards: np.ndarray, distance: float, size_px: int) -> Camera:
    """Build a square camera `distance` radii away in the direction `towards` (3,), zoomed to the object (v, 3)."""
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
    """Compute the camera axes (3, 3) in the object frame for a viewing direction.

    z is along `forward`, y points down as far as possible; views from above and below have y towards -y.
    """
    z = forward / np.linalg.norm(forward)
    down = np.array([0, 0, -1.0]) if abs(z[2]) < 0.999 else np.array([0, -1.0, 0])
    x = np.cross(down, z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
