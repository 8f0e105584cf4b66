"""n objects and a hand as arrays, and what an episode of each begins with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.task import NEGATIVE_POINTS, Task, spread_points
from afford.grasping.hand.kinematics import forward_kinematics, moving_joints
from afford.grasping.sim.engine import State
from schemas.hand import HandModel

OBJECT_POINTS = 128
"""of the surface, as far apart as can be"""
SAFE_M = 0.02
"""what is farther from every negative point is safe, as in AffordDex"""


@dataclass(frozen=True, eq=False)
class Episode:
    """What an episode began with, in n worlds. Its frame has its origin at the object's centre of mass at rest, z up, x along the
    part to hold, towards that centre.
    """

    origin: np.ndarray
    """(n, 3) centre of mass at rest, world"""
    yaw: np.ndarray
    """(n,) of the frame"""
    goal: np.ndarray
    """(n, 3) where the centre of mass is to be, world"""


@dataclass(frozen=True, eq=False)
class Scenery:
    """What stays the same from episode to episode."""

    hand: HandModel
    com: np.ndarray
    """(n, 3) object frame"""
    surface: np.ndarray
    """(n, k, 3) points of the object, object frame"""
    allowed: np.ndarray
    """(n, k) bool, farther than SAFE_M from every negative point; all where none is"""
    N_object: np.ndarray
    """(n, 100, 3) negative points that a policy is shown, object frame; zero where there are none"""
    A_object: np.ndarray
    """(n, 100, 3) points where hands belong, object frame; zero where none are known"""
    any_positive: np.ndarray
    """(n,) bool"""
    any_negative: np.ndarray
    """(n,) bool"""
    N_true: np.ndarray
    """(n, 100, 3) the same in truth, for judging"""
    any_true: np.ndarray
    """(n,) bool"""
    negative: np.ndarray
    """(n, p) bool, parts that must not be touched, in truth"""
    told: np.ndarray
    """(n, p) bool, parts that N_t says must not be touched"""
    palm_offset: np.ndarray
    """(3,) the middle of the palm, half-way from its origin to the knuckle of the middle finger, in its frame"""

    def centre(self, state: State) -> np.ndarray:
        """(n, 3) centre of mass, world."""
        return to_world(state.body, self.com[:, None])[:, 0]

    def points(self, state: State) -> np.ndarray:
        """(n, k, 3) surface, world."""
        return to_world(state.body, self.surface)

    def negative_points(self, state: State) -> np.ndarray:
        """(n, 100, 3) negative points, world."""
        return to_world(state.body, self.N_object)

    def true_points(self, state: State) -> np.ndarray:
        """(n, 100, 3) points that must not be touched, in truth, world."""
        return to_world(state.body, self.N_true)

    def positive_points(self, state: State) -> np.ndarray:
        """(n, 100, 3) points where hands belong, world."""
        return to_world(state.body, self.A_object)

    def palm(self, state: State) -> np.ndarray:
        """(n, 3) middle of the palm, world."""
        return to_world(state.palm, self.palm_offset[None, None])[:, 0]


def scenery(hand: HandModel, tasks: Sequence[Task]) -> Scenery:
    """Tasks side by side; objects with fewer parts have more that are not negative, and that nothing touches."""
    parts = max(len(one.negative) for one in tasks)
    surface = [spread_points(one.body.points.astype(np.float64), OBJECT_POINTS) for one in tasks]
    allowed = [_apart(points, one.N_t) for one, points in zip(tasks, surface, strict=True)]
    return Scenery(
        hand=hand, com=np.stack([one.body.com_m for one in tasks]), surface=np.stack(surface), allowed=np.stack(allowed),
        N_object=np.stack([_hundred(one.N_t) for one in tasks]), A_object=np.stack([_hundred(one.A_t) for one in tasks]),
        any_positive=np.array([len(one.A_t) > 0 for one in tasks]),
        any_negative=np.array([len(one.N_t) > 0 for one in tasks]),
        N_true=np.stack([_hundred(one.N_true) for one in tasks]), any_true=np.array([len(one.N_true) > 0 for one in tasks]),
        negative=np.stack([np.pad(one.negative, (0, parts - len(one.negative))) for one in tasks]),
        told=np.stack([np.pad(one.told, (0, parts - len(one.told))) for one in tasks]),
        palm_offset=_middle_of_palm(hand))  # fmt: skip


def to_world(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n, 7) poses of frames, (n, k, 3) points in them -> world."""
    R = Rotation.from_quat(pose[:, 3:]).as_matrix()
    return points @ R.swapaxes(1, 2) + pose[:, None, :3]


def about_z(yaw: np.ndarray) -> Rotation:
    """n turns about the vertical by yaw (n,)."""
    return Rotation.from_rotvec(np.multiply.outer(yaw, [0.0, 0.0, 1.0]))


def to_frame(vectors: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """(n, ..., 3) directions of the world along the axes of frames turned by yaw (n,) about the vertical."""
    c, s = (f(yaw).reshape(-1, *[1] * (vectors.ndim - 2)) for f in (np.cos, np.sin))
    x, y = vectors[..., 0], vectors[..., 1]
    out = np.array(vectors, np.float64)
    out[..., 0], out[..., 1] = c * x + s * y, c * y - s * x
    return out


def palm_yaw(hand: HandModel, state: State) -> np.ndarray:
    """(n,) where the fingers point, seen from above (the palm's grip axis z)."""
    z = Rotation.from_quat(state.palm[:, 3:]).as_matrix() @ hand.R_palm_grip[:, 2]
    return np.arctan2(z[:, 1], z[:, 0])


def _hundred(points: np.ndarray) -> np.ndarray:
    """(100, 3) of points (k, 3), zero where there is none."""
    return spread_points(points, NEGATIVE_POINTS) if len(points) else np.zeros((NEGATIVE_POINTS, 3))


def _apart(points: np.ndarray, N_t: np.ndarray) -> np.ndarray:
    """(k,) bool: points (k, 3) that are farther than SAFE_M from all of N_t (m, 3); all of them where none is."""
    far = (np.linalg.norm(points[:, None] - N_t[None], axis=2) > SAFE_M).all(axis=1)
    return far if far.any() else np.ones(len(points), bool)


def _middle_of_palm(hand: HandModel) -> np.ndarray:
    T = forward_kinematics(hand.joints, np.zeros((1, len(moving_joints(hand.joints)))))[0]
    names = hand.fingers.name
    knuckle = hand.fingers.base_link[names.index("middle") if "middle" in names else -1]
    found: np.ndarray = 0.5 * (np.linalg.inv(T[hand.palm]) @ T[knuckle])[:3, 3]
    return found
