"""A robot hand and what it should reach: the errors of every frame and how they change with the palm and the motors.

A frame has 6 + m unknowns: a twist of the palm in the world, and the motors. The wrist is a twist and not the gantry's angles,
which are worthless where its pitch is a right angle: there the thumb points up, as when a mug is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.hand.coupling import driven, spread
from afford.grasping.hand.kinematics import forward, jacobian, limits, moving, points
from afford.grasping.motion.points import OF_FINGER, TIP, HandPoints
from afford.grasping.motion.targets import Targets
from schemas.hand import HandModel

REST = 1e-7
"""weight (m/rad)^2 of staying near the middle of a joint, which decides where the points do not"""


@dataclass(frozen=True)
class Weights:
    """What a metre of each kind of error counts, and what an acceleration does."""

    level_1: float
    level_2: float
    """middle and distal joints"""
    tips: float
    pinch: float
    """of the vectors from the thumb's tip to the others, where both are close"""
    pinch_m: float
    """how close: the weight falls to 1/e at this distance"""
    acceleration_m: float
    """error that is worth 100 rad/s^2 of a joint or of the palm, or 10 m/s^2 of the palm"""


@dataclass(frozen=True, eq=False)
class State:
    """A hand in t frames."""

    palm: np.ndarray
    """(t, 4, 4) pose in the world"""
    motors: np.ndarray
    """(t, m) actuated joints, rad"""

    def moved(self, step: np.ndarray, low: np.ndarray, high: np.ndarray) -> State:
        """After a step (t, 6 + m), motors cut at their limits."""
        palm = self.palm.copy()
        palm[:, :3, 3] += step[:, :3]
        palm[:, :3, :3] = Rotation.from_rotvec(step[:, 3:6]).as_matrix() @ palm[:, :3, :3]
        return State(palm, np.clip(self.motors + step[:, 6:], low, high))


class Problem:
    """A hand and what it should reach: errors, their slopes, and where everything is."""

    def __init__(self, hand: HandModel, which: HandPoints, goal: Targets, weights: Weights) -> None:
        self.hand, self.which, self.goal, self.weights = hand, which, goal, weights
        roles = np.array([hand.joints.role[k] for k in driven(hand.joints)])
        A, self.offset = spread(hand.joints)
        self.A = A[:, roles == "actuated"]
        self.low, self.high = (column[[moving(hand.joints).tolist().index(k) for k in driven(hand.joints)[roles == "actuated"]]]
                               for column in limits(hand.joints).T)  # fmt: skip
        self.size = 6 + len(self.low)
        level = np.sqrt([weights.level_1, weights.level_2, weights.level_2, weights.tips])
        near = np.exp(-np.square(np.linalg.norm(goal.pinches_m, axis=-1) / weights.pinch_m))
        self.scale = np.concatenate([np.tile(level, (len(goal.palm), len(which.keypoint))), np.sqrt(weights.pinch * near)], axis=1)

    def start(self) -> State:
        """The person's palm, and every motor in the middle of its range."""
        return State(self.goal.palm, np.tile((self.low + self.high) / 2, (len(self.goal.palm), 1)))

    def q(self, state: State) -> np.ndarray:
        """(t, d) with the wrist at rest."""
        found: np.ndarray = state.motors @ self.A.T + self.offset
        return found

    def points_of(self, state: State) -> np.ndarray:
        """(t, 4 f, 3) in the world."""
        return self._world(state, self._links(state)[1])

    def errors(self, state: State) -> np.ndarray:
        """(t, r) weighted errors in metres, rest included."""
        return self._errors(state, self.points_of(state))

    def normal(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """J^T J (t, s, s) and J^T e (t, s)."""
        T, local = self._links(state)
        R = state.palm[:, None, :3, :3]
        arm = (R @ local[..., None])[..., 0]
        to_world = R @ np.swapaxes(T[:, None, self.hand.palm, :3, :3], -1, -2)
        fingers = to_world @ (jacobian(self.hand.joints, T, self.which.links, self.which.offsets_m) @ self.A)
        slope = np.concatenate([np.broadcast_to(np.eye(3), (*arm.shape, 3)), -_cross(arm), fingers], axis=-1)
        tips = slope[:, TIP::OF_FINGER]
        slope = np.concatenate([slope, tips[:, 1:] - tips[:, :1]], axis=1) * self.scale[..., None, None]
        slope = slope.reshape(len(slope), -1, self.size)
        errors = self._errors(state, self._world(state, local))
        H = np.swapaxes(slope, 1, 2) @ slope
        motors = np.arange(6, self.size)
        H[:, motors, motors] += REST
        g = (np.swapaxes(slope, 1, 2) @ errors[:, : slope.shape[1], None])[..., 0]
        g[:, 6:] += np.sqrt(REST) * errors[:, slope.shape[1] :]
        return H, g

    def _links(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Poses of links with the wrist at rest, and the points in the palm's frame."""
        T = forward(self.hand.joints, self.q(state))
        return T, points(np.linalg.inv(T[:, self.hand.palm])[:, None] @ T, self.which.links, self.which.offsets_m)

    def _world(self, state: State, local: np.ndarray) -> np.ndarray:
        found: np.ndarray = np.einsum("tij,tkj->tki", state.palm[:, :3, :3], local) + state.palm[:, None, :3, 3]
        return found

    def _errors(self, state: State, ours: np.ndarray) -> np.ndarray:
        theirs = self.goal.points_m.reshape(ours.shape)
        tips = ours[:, TIP::OF_FINGER]
        errors = np.concatenate([ours - theirs, tips[:, 1:] - tips[:, :1] - self.goal.pinches_m], axis=1) * self.scale[..., None]
        rest = np.sqrt(REST) * (state.motors - (self.low + self.high) / 2)
        return np.concatenate([errors.reshape(len(ours), -1), rest], axis=1)


def _cross(rows: np.ndarray) -> np.ndarray:
    """(..., 3) -> (..., 3, 3): the matrices whose product with a vector is the cross product."""
    out = np.zeros((*rows.shape, 3))
    x, y, z = np.moveaxis(rows, -1, 0)
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out
