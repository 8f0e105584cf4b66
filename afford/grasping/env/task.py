"""What is to be grasped, by which part, and where a hand must not go, as it is told (N_t) and in truth; where the object begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from afford.common.geometry import farthest_point_sampling
from schemas.grasp import GraspObject, GraspTask

NEGATIVE_POINTS = 100
"""as AffordDex has it"""


@dataclass(frozen=True, eq=False)
class Task:
    """One object and one use of it."""

    body: GraspObject
    hold: int
    """index of the part that is to be held"""
    negative: np.ndarray
    """(p,) bool, parts that must not be touched; in truth, for judging"""
    N_true: np.ndarray
    """(100, 3) float64 m, object frame, points of these parts, for judging; (0, 3) when there are none"""
    N_t: np.ndarray
    """(100, 3) float64 m, object frame, negative points that a policy is shown and rewards look at; (0, 3) when there are none"""
    told: np.ndarray
    """(p,) bool, parts that N_t says must not be touched, for the same"""
    A_t: np.ndarray
    """(k, 3) float64 m, object frame, points where hands belong, which rewards may look at; (0, 3) when none are known"""

    def __repr__(self) -> str:
        bad = [name for name, negative in zip(self.body.parts, self.negative, strict=True) if negative]
        return f"Task({self.body.name!r}, hold={self.body.parts[self.hold]!r}, negative={bad})"


def task(body: GraspObject, negative: Sequence[str] = (), hold: str = "", N_t: np.ndarray | None = None,
         told: Sequence[str] | None = None, A_t: np.ndarray | None = None) -> Task:  # fmt: skip
    """A task; `hold` is the largest part that is not negative where it is not named, N_t comes from the negative parts' own points
    where none (k, 3) are given, `told` are the negative parts where it is not given, A_t (k, 3) is empty. ValueError for parts that
    the object lacks, or none that is left to hold.
    """
    unknown = sorted({*negative, *(told or ()), *filter(None, [hold])} - set(body.parts))
    if unknown:
        raise ValueError(f"{body.name}: expected parts among {', '.join(body.parts)}, got {', '.join(unknown)}")
    bad = np.array([name in negative for name in body.parts])
    size = np.bincount(body.point_part, minlength=len(bad)) * ~bad
    part = body.parts.index(hold) if hold else int(size.argmax())
    if not size[part]:
        raise ValueError(f"{body.name}: expected a part with points on it that may be held, got negative parts "
                         f"{', '.join(negative)}{f' and hold={hold!r}' if hold else ''}")
    true = spread_points(body.points[bad[body.point_part]].astype(np.float64), NEGATIVE_POINTS)
    shown = true if N_t is None else spread_points(np.asarray(N_t, np.float64), NEGATIVE_POINTS)
    said = bad if told is None else np.array([name in told for name in body.parts])
    return Task(body, part, bad, true, shown, said, np.zeros((0, 3)) if A_t is None else A_t)


def of(given: GraspTask) -> Task:
    """A task as the pipeline passes it on; N_t is what it says, also where that is not the truth."""
    return task(given.body, given.negative, given.hold, given.N_t, given.told, given.A_t)


def spread_points(points: np.ndarray, count: int) -> np.ndarray:
    """(count, 3) of the points (k, 3), farthest apart first; again from the first when there are fewer; (0, 3) of none."""
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ValueError(f"points: expected finite (k, 3), got shape {points.shape}")
    chosen = farthest_point_sampling(points, count)
    return points[np.resize(chosen, count)] if len(chosen) else np.zeros((0, 3))


def placed(body: GraspObject, rest: np.ndarray, xy_m: np.ndarray, yaw_rad: float) -> np.ndarray:
    """(7,) the pose at rest, turned about the vertical, with its centre of mass over xy; its height stays."""
    turn = Rotation.from_euler("z", yaw_rad)
    lying = turn * Rotation.from_quat(rest[3:])
    under = np.append(xy_m, rest[2]) - lying.apply(np.array(body.com_m)) * (1, 1, 0)
    return np.concatenate([under, lying.as_quat()])
