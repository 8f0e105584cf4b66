"""Smooth rigid motion: minimum-jerk timing, blended rotations, and tracks made of segments. Poses are (4, 4) float64, T_a_b."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Pose = np.ndarray
PoseAt = Callable[[float], Pose]


def ease(s: float) -> float:
    """Minimum-jerk progress (Flash and Hogan 1985) of s in 0..1; 0 before, 1 after; no speed and no acceleration at both ends."""
    s = min(max(s, 0.0), 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def pose(position: np.ndarray | tuple[float, ...], rotation: np.ndarray | None = None) -> Pose:
    """A pose from a position (3,) in metres and a rotation (3, 3), identity when not given."""
    out = np.eye(4)
    out[:3, 3] = position
    if rotation is not None:
        out[:3, :3] = rotation
    return out


def about(axis: np.ndarray | tuple[float, ...], angle_rad: float) -> np.ndarray:
    """Rotation (3, 3) about an axis (3,), by Rodrigues."""
    unit = np.asarray(axis, float) / np.linalg.norm(axis)
    cross = np.array([[0, -unit[2], unit[1]], [unit[2], 0, -unit[0]], [-unit[1], unit[0], 0]])
    return np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross


def log_rotation(rotation: np.ndarray) -> np.ndarray:
    """Rotation vector (3,) in radians of a rotation (3, 3); norm at most pi."""
    angle = np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1))
    skew = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    if angle < np.pi - 1e-3:
        return skew / 2 if angle < 1e-6 else skew * angle / (2 * np.sin(angle))
    axis = (rotation + np.eye(3))[:, np.argmax(np.diag(rotation))]
    sign = 1.0 if skew @ axis >= 0 else -1.0
    return sign * axis / np.linalg.norm(axis) * angle


def blend(a: Pose, b: Pose, s: float) -> Pose:
    """Between two poses: straight line for the position, shortest turn for the rotation; s in 0..1 is used as given."""
    turn = log_rotation(a[:3, :3].T @ b[:3, :3])
    angle = float(np.linalg.norm(turn))
    rotation = a[:3, :3] @ about(turn, angle * s) if angle > 1e-9 else a[:3, :3]
    return pose((1 - s) * a[:3, 3] + s * b[:3, 3], rotation)


def arc(a: Pose, b: Pose, lift: np.ndarray) -> PoseAt:
    """From a to b along a bow whose middle is displaced by `lift` (3,) metres; takes progress 0..1."""

    def at(s: float) -> Pose:
        out = blend(a, b, ease(s))
        out[:3, 3] += lift * 4 * ease(s) * (1 - ease(s))
        return out

    return at


def approach(a: Pose, b: Pose, leave: np.ndarray, arrive: np.ndarray) -> PoseAt:
    """From a to b along a curve that bends out along `leave` (3,) at first and comes in along `arrive` (3,), both in metres."""

    def at(s: float) -> Pose:
        t = ease(s)
        out = blend(a, b, ease(min(1.0, 1.2 * s)))
        out[:3, 3] = (1 - t) * a[:3, 3] + t * b[:3, 3] + 4 * t * (1 - t) * ((1 - t) * leave - t * arrive)
        return out

    return at


@dataclass
class Track:
    """A pose over time: segments one after another; before the first and after the last it stands still."""

    rest: Pose
    segments: list[tuple[float, float, PoseAt]]

    def at(self, time: float) -> Pose:
        """The pose at a time."""
        current = self.rest
        for start, stop, path in self.segments:
            if time < start:
                break
            current = path(min(1.0, (time - start) / (stop - start)))
        return current

    def add(self, start: float, stop: float, path: PoseAt) -> None:
        """Append a segment; `path` takes progress 0..1. ValueError when it starts before the last one ends or is empty."""
        if stop <= start or (self.segments and start < self.segments[-1][1] - 1e-9):
            raise ValueError(f"Track: expected a segment after {self.segments[-1][1] if self.segments else 0}, got {start}..{stop}")
        self.segments.append((start, stop, path))

    def end(self) -> Pose:
        """Where the last segment ends."""
        return self.segments[-1][2](1.0) if self.segments else self.rest

    def end_path(self) -> Callable[[], Pose]:
        """Where the last segment so far ends, evaluated when asked."""
        last = len(self.segments)
        return lambda: self.segments[last - 1][2](1.0) if last else self.rest


@dataclass
class Curve:
    """A vector over time: minimum-jerk steps between values; used for joints and finger postures."""

    rest: np.ndarray
    steps: list[tuple[float, float, np.ndarray]]

    def at(self, time: float) -> np.ndarray:
        """The value at a time."""
        current = self.rest
        for start, stop, target in self.steps:
            if time <= start:
                break
            current = current + (target - current) * ease((time - start) / (stop - start))
        return current

    def add(self, start: float, stop: float, target: np.ndarray | float) -> None:
        """Go to `target` between two times."""
        self.steps.append((start, stop, np.atleast_1d(np.asarray(target, float))))


def sway(rng: np.random.Generator, size: int, periods: tuple[float, float], count: int = 3) -> Callable[[float], np.ndarray]:
    """Slow aperiodic wandering (size,) of unit amplitude: a few sines with random phases; periods in units of time."""
    period = rng.uniform(*periods, (count, size))
    phase = rng.uniform(0, 2 * np.pi, (count, size))
    weight = rng.uniform(0.5, 1.0, (count, size))
    weight /= weight.sum(0)
    return lambda time: (weight * np.sin(2 * np.pi * time / period + phase)).sum(0)
