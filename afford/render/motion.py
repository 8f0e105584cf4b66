"""Smooth rigid motion: minimum-jerk timing, interpolated rotations, trajectories of segments.

Poses are (4, 4) float64, T_a_b.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Pose = np.ndarray
PoseAt = Callable[[float], Pose]


def ease(s: float) -> float:
    """Minimum-jerk progress (Flash and Hogan 1985) for s in 0..1; 0 before, 1 after."""
    s = min(max(s, 0.0), 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def pose(position: np.ndarray | tuple[float, ...], rotation: np.ndarray | None = None) -> Pose:
    """Build a pose from a position (3,) in metres and a rotation (3, 3), by default the identity."""
    out = np.eye(4)
    out[:3, 3] = position
    if rotation is not None:
        out[:3, :3] = rotation
    return out


def axis_angle(axis: np.ndarray | tuple[float, ...], angle_rad: float) -> np.ndarray:
    """Compute the rotation (3, 3) about an axis (3,) by Rodrigues' formula."""
    unit = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -unit[2], unit[1]], [unit[2], 0, -unit[0]], [-unit[1], unit[0], 0]])
    return np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross


def log_rotation(rotation: np.ndarray) -> np.ndarray:
    """Compute the rotation vector (3,) in radians of a rotation (3, 3); its norm is at most pi."""
    angle = np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    if angle < np.pi - 1e-3:
        return skew / 2 if angle < 1e-6 else skew * angle / (2 * np.sin(angle))
    axis = (rotation + np.eye(3))[:, np.argmax(np.diag(rotation))]
    sign = 1.0 if skew @ axis >= 0 else -1.0
    return sign * axis / np.linalg.norm(axis) * angle


def blend(a: Pose, b: Pose, s: float) -> Pose:
    """Interpolate two poses: linear position, shortest rotation; s in 0..1 without easing."""
    turn = log_rotation(a[:3, :3].T @ b[:3, :3])
    angle = float(np.linalg.norm(turn))
    rotation = a[:3, :3] @ axis_angle(turn, angle * s) if angle > 1e-9 else a[:3, :3]
    return pose((1 - s) * a[:3, 3] + s * b[:3, 3], rotation)


def arc(a: Pose, b: Pose, lift: np.ndarray) -> PoseAt:
    """Return a path from a to b whose middle is displaced by `lift` (3,) metres; it takes progress 0..1."""

    def at(s: float) -> Pose:
        out = blend(a, b, ease(s))
        out[:3, 3] += lift * 4 * ease(s) * (1 - ease(s))
        return out

    return at


def approach(a: Pose, b: Pose, leave: np.ndarray, arrive: np.ndarray) -> PoseAt:
    """Return a path from a to b that leaves along `leave` (3,) and arrives along `arrive` (3,), both in metres."""

    def at(s: float) -> Pose:
        t = ease(s)
        out = blend(a, b, ease(min(1.0, 1.2 * s)))
        out[:3, 3] = (1 - t) * a[:3, 3] + t * b[:3, 3] + 4 * t * (1 - t) * ((1 - t) * leave - t * arrive)
        return out

    return at


@dataclass
class Track:
    """Pose over time, made of consecutive segments; constant before the first and after the last one."""

    rest: Pose
    segments: list[tuple[float, float, PoseAt]]

    def at(self, time: float) -> Pose:
        """Compute the pose at a time."""
        current = self.rest
        for start, stop, path in self.segments:
            if time < start:
                break
            current = path(min(1.0, (time - start) / (stop - start)))
        return current

    def add(self, start: float, stop: float, path: PoseAt) -> None:
        """Append a segment; `path` takes progress 0..1. ValueError for an empty or overlapping segment."""
        if stop <= start or (self.segments and start < self.segments[-1][1] - 1e-9):
            raise ValueError(f"Track: expected a segment after {self.segments[-1][1] if self.segments else 0}, got {start}..{stop}")
        self.segments.append((start, stop, path))

    def end(self) -> Pose:
        """Return the pose at the end of the last segment."""
        return self.segments[-1][2](1.0) if self.segments else self.rest

    def end_path(self) -> Callable[[], Pose]:
        """Return a function that computes the pose at the end of the current last segment."""
        last = len(self.segments)
        return lambda: self.segments[last - 1][2](1.0) if last else self.rest


@dataclass
class Curve:
    """Vector over time, made of minimum-jerk steps between values; for joints and finger postures."""

    rest: np.ndarray
    steps: list[tuple[float, float, np.ndarray]]

    def at(self, time: float) -> np.ndarray:
        """Compute the value at a time."""
        current = self.rest
        for start, stop, target in self.steps:
            if time <= start:
                break
            current = current + (target - current) * ease((time - start) / (stop - start))
        return current

    def add(self, start: float, stop: float, target: np.ndarray | float) -> None:
        """Move to `target` between two times."""
        self.steps.append((start, stop, np.atleast_1d(np.asarray(target, float))))


def sway(rng: np.random.Generator, size: int, periods: tuple[float, float], count: int = 3) -> Callable[[float], np.ndarray]:
    """Return a slow aperiodic motion (size,) of unit amplitude: sines with random phases and periods."""
    period = rng.uniform(*periods, (count, size))
    phase = rng.uniform(0, 2 * np.pi, (count, size))
    weight = rng.uniform(0.5, 1.0, (count, size))
    weight /= weight.sum(0)
    return lambda time: (weight * np.sin(2 * np.pi * time / period + phase)).sum(0)
