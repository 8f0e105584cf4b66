"""Constants of n worlds as arrays (hand, objects, points), the frames of their episodes, and changes of frame.

Functions of states also take tensors (afford/common/arrays.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from afford.common.arrays import copied, like, namespace
from afford.grasping.env.rotations import rotation_matrix
from afford.grasping.env.task import NEGATIVE_POINTS, Task, spread_points
from afford.grasping.hand.kinematics import forward_kinematics, moving_joints
from afford.grasping.sim.engine import State
from schemas.hand import HandModel

OBJECT_POINTS = 128
"""points of the surface, by farthest point sampling"""
SAFE_M = 0.02
"""a point is safe when it is farther than this from every negative point, as in AffordDex"""


@dataclass(frozen=True, eq=False)
class EpisodeFrame:
    """Frames and goals of the running episodes of n worlds.

    The origin of a frame is the object's centre of mass at rest; z is up, x along the part to hold, towards that centre.
    """

    origin: np.ndarray
    """(n, 3) centre of mass at rest, world"""
    yaw: np.ndarray
    """(n,) yaw of the frame"""
    goal: np.ndarray
    """(n, 3) goal of the centre of mass, world"""


@dataclass(frozen=True, eq=False)
class Scenery:
    """Constants of n worlds, the same in every episode."""

    hand: HandModel
    com: np.ndarray
    """(n, 3) centre of mass, object frame"""
    surface: np.ndarray
    """(n, k, 3) points of the object, object frame"""
    allowed: np.ndarray
    """(n, k) bool, surface points farther than SAFE_M from every negative point; all of them if none is"""
    N_object: np.ndarray
    """(n, 100, 3) negative points N_t that a policy observes, object frame; zero without any"""
    A_object: np.ndarray
    """(n, 100, 3) positive points A_t, object frame; zero without any"""
    any_positive: np.ndarray
    """(n,) bool"""
    any_negative: np.ndarray
    """(n,) bool"""
    N_true: np.ndarray
    """(n, 100, 3) true negative points, for evaluation, object frame"""
    any_true: np.ndarray
    """(n,) bool"""
    negative: np.ndarray
    """(n, p) bool, parts that are negative in truth"""
    told: np.ndarray
    """(n, p) bool, parts that are negative by N_t"""
    palm_offset: np.ndarray
    """(3,) middle of the palm in its frame: half-way from its origin to the knuckle of the middle finger"""

    def centre(self, state: State) -> np.ndarray:
        """(n, 3) centres of mass, world."""
        return to_world(state.body, self.com[:, None])[:, 0]

    def points(self, state: State) -> np.ndarray:
        """(n, k, 3) surface points, world."""
        return to_world(state.body, self.surface)

    def negative_points(self, state: State) -> np.ndarray:
        """(n, 100, 3) negative points N_t, world."""
        return to_world(state.body, self.N_object)

    def true_points(self, state: State) -> np.ndarray:
        """(n, 100, 3) true negative points, world."""
        return to_world(state.body, self.N_true)

    def positive_points(self, state: State) -> np.ndarray:
        """(n, 100, 3) positive points A_t, world."""
        return to_world(state.body, self.A_object)

    def palm(self, state: State) -> np.ndarray:
        """(n, 3) middles of the palms, world."""
        return to_world(state.palm, self.palm_offset[None, None])[:, 0]


def build_scenery(hand: HandModel, tasks: Sequence[Task]) -> Scenery:
    """Stack the constants of n tasks. Objects with fewer parts are padded with empty parts that are not negative."""
    parts = max(len(one.negative) for one in tasks)
    surface = [spread_points(one.body.points.astype(np.float64), OBJECT_POINTS) for one in tasks]
    allowed = [_safe(points, one.N_t) for one, points in zip(tasks, surface, strict=True)]
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
    """Transform points (n, k, 3) from frames with poses (n, 7) to the world."""
    found: np.ndarray = points @ rotation_matrix(pose[:, 3:]).swapaxes(1, 2) + pose[:, None, :3]
    return found


def to_frame(vectors: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Rotate world vectors (n, ..., 3) into frames turned by yaw (n,) about the vertical."""
    xp = namespace(vectors)
    c, s = (f(yaw).reshape(-1, *[1] * (vectors.ndim - 2)) for f in (xp.cos, xp.sin))
    x, y = vectors[..., 0], vectors[..., 1]
    out: np.ndarray = np.array(vectors, np.float64) if xp is np else copied(vectors)
    out[..., 0], out[..., 1] = c * x + s * y, c * y - s * x
    return out


def palm_yaw(hand: HandModel, state: State) -> np.ndarray:
    """(n,) yaw of the direction of the fingers, seen from above (the palm's grip axis z)."""
    z = rotation_matrix(state.palm[:, 3:]) @ like(hand.R_palm_grip[:, 2], state.palm)
    found: np.ndarray = namespace(z).arctan2(z[:, 1], z[:, 0])
    return found


def _hundred(points: np.ndarray) -> np.ndarray:
    """(100, 3) sample of points (k, 3); zero without any."""
    return spread_points(points, NEGATIVE_POINTS) if len(points) else np.zeros((NEGATIVE_POINTS, 3))


def _safe(points: np.ndarray, N_t: np.ndarray) -> np.ndarray:
    """(k,) bool, points (k, 3) farther than SAFE_M from all of N_t (m, 3); all of them if none is."""
    far = (np.linalg.norm(points[:, None] - N_t[None], axis=2) > SAFE_M).all(axis=1)
    return far if far.any() else np.ones(len(points), bool)


def _middle_of_palm(hand: HandModel) -> np.ndarray:
    T = forward_kinematics(hand.joints, np.zeros((1, len(moving_joints(hand.joints)))))[0]
    names = hand.fingers.name
    knuckle = hand.fingers.base_link[names.index("middle") if "middle" in names else -1]
    found: np.ndarray = 0.5 * (np.linalg.inv(T[hand.palm]) @ T[knuckle])[:3, 3]
    return found
