"""A head-worn camera: where it stands, what it looks at, and how a head never quite stands still."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.render.motion import Pose, about, ease, pose, sway


@dataclass(frozen=True)
class HeadStyle:
    """How lively the head is."""

    sway_m: float
    """amplitude of the wandering of the head"""
    turn_deg: float
    """amplitude of the wandering of the gaze"""
    roll_deg: float
    """amplitude of the roll"""
    orbit_m: float
    """sideways travel over the whole clip: the stronger, the more parallax"""


CALM = HeadStyle(sway_m=0.033, turn_deg=3.9, roll_deg=2.0, orbit_m=0.07)
PARALLAX = HeadStyle(sway_m=0.05, turn_deg=4.0, roll_deg=2.5, orbit_m=0.20)


def look_at(eye: np.ndarray, target: np.ndarray, roll_rad: float = 0.0) -> Pose:
    """T_world_cam of a camera at `eye` (3,) that looks at `target` (3,), metres; x right, y down, z forward; world z up."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    frame = np.stack([right, np.cross(forward, right), forward], 1)
    return pose(eye, frame @ about((0, 0, 1), roll_rad))


def intrinsics(width: int, height: int, field_of_view_deg: float) -> np.ndarray:
    """K (3, 3) of a pinhole camera with square pixels; the field of view is horizontal."""
    focal = 0.5 * width / np.tan(np.radians(field_of_view_deg) / 2)
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])


class Head:
    """The pose of the camera at any time: gaze targets that follow the action, plus wandering."""

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
        """T_world_cam at a time."""
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
