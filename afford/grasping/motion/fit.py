"""Fit a robot hand to keypoint targets with Levenberg-Marquardt: first every frame alone, then the clip with a smoothness term.

A frame has 6 + m unknowns: a twist of the palm in the world, and the motors. A twist, rather than the angles of the gantry, stays
regular where the gantry's pitch is a right angle: there the thumb points up, as when a mug is grasped. Motors stay within their
limits exactly: steps are clipped, and a motor that would leave its range is held (projected Gauss-Newton).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solveh_banded
from scipy.spatial.transform import Rotation

from afford.grasping.hand.kinematics import (
    commanded_joints,
    coupling_matrix,
    forward_kinematics,
    jacobian,
    joint_limits,
    moving_joints,
    points_on_links,
)
from afford.grasping.motion.targets import OF_FINGER, TIP, HandPoints, Targets
from schemas.hand import HandModel

DAMPING, DAMPING_RANGE = 1e-3, (1e-9, 1e6)
ENOUGH = 1e-7
"""a decrease below this share of the cost ends the fit"""


def fit_frames(problem: RetargetProblem, steps: int) -> FitState:
    """Fit every frame alone, from the middle of its joint ranges, with its own damping."""
    state = problem.start()
    cost = np.square(problem.errors(state)).sum(axis=1)
    damping = np.full(len(cost), DAMPING)
    for _ in range(steps):
        H, g = problem.normal(state)
        H, g, _ = _held(problem, state, H, g)
        step = -np.linalg.solve(_damped(H, damping[:, None]), g[..., None])[..., 0]
        tried = state.moved(step, problem.low, problem.high)
        new = np.square(problem.errors(tried)).sum(axis=1)
        better = new < cost
        state = FitState(np.where(better[:, None, None], tried.palm, state.palm),
                      np.where(better[:, None], tried.motors, state.motors))
        cost = np.where(better, new, cost)
        damping = np.clip(np.where(better, damping / 5, damping * 4), *DAMPING_RANGE)
    return state


def fit_clip(problem: RetargetProblem, state: FitState, rate_hz: float, steps: int) -> FitState:
    """Fit all frames together, starting from the fits of single frames.

    Clips of fewer than three frames have no acceleration and are returned unchanged.
    """
    if len(state.motors) < 3:
        return state
    price = _prices(problem, rate_hz)
    cost, damping = _clip_cost(problem, state, price), DAMPING
    for _ in range(steps):
        H, g = problem.normal(state)
        H, g, free = _held(problem, state, H, g + price * _transposed(_second(state)))
        step = -_solve_banded(_damped(H, np.full((len(H), 1), damping)), g, free, price)
        tried = state.moved(step, problem.low, problem.high)
        new = _clip_cost(problem, tried, price)
        if new < cost:
            gain, state, cost, damping = cost - new, tried, new, max(damping / 5, DAMPING_RANGE[0])
            if gain < ENOUGH * cost:
                break
        else:
            damping = min(damping * 4, DAMPING_RANGE[1])
    return state


def _held(problem: RetargetProblem, state: FitState, H: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hold motors that are at a limit and would exceed it: their rows and columns become those of the identity.

    Returns H, g and (t, s), 1 for free unknowns, else 0.
    """
    out = ((state.motors <= problem.low) & (g[:, 6:] > 0)) | ((state.motors >= problem.high) & (g[:, 6:] < 0))
    free = np.concatenate([np.ones((len(g), 6)), ~out], axis=1)
    H = H * free[:, :, None] * free[:, None]
    each = np.arange(problem.size)
    H[:, each, each] += 1 - free
    return H, g * free, free


def _damped(H: np.ndarray, damping: np.ndarray) -> np.ndarray:
    H = H.copy()
    each = np.arange(H.shape[1])
    H[:, each, each] += damping * H[:, each, each] + 1e-12
    return H


def _prices(problem: RetargetProblem, rate_hz: float) -> np.ndarray:
    """Return the (s,) weight of a squared second difference between frames."""
    each = np.full(problem.size, 100.0)
    each[:3] = 10.0
    return np.square(problem.weights.acceleration_m * rate_hz**2 / each)


def _second(state: FitState) -> np.ndarray:
    """Compute (t - 2, s) second differences; rotations of the palm are in the world frame."""
    R = state.palm[:, :3, :3]
    turn = Rotation.from_matrix(R[1:] @ np.swapaxes(R[:-1], 1, 2)).as_rotvec()
    palm, motors = np.diff(state.palm[:, :3, 3], 2, axis=0), np.diff(state.motors, 2, axis=0)
    return np.concatenate([palm, np.diff(turn, axis=0), motors], axis=1)


def _transposed(second: np.ndarray) -> np.ndarray:
    """Apply the transposed difference operator, (t - 2, s) -> (t, s): the gradient of half the squared second differences."""
    out = np.zeros((len(second) + 2, second.shape[1]))
    out[:-2] += second
    out[1:-1] -= 2 * second
    out[2:] += second
    return out


def _clip_cost(problem: RetargetProblem, state: FitState, price: np.ndarray) -> float:
    return float(np.square(problem.errors(state)).sum() + (price * np.square(_second(state))).sum())


def _solve_banded(H: np.ndarray, g: np.ndarray, free: np.ndarray, price: np.ndarray) -> np.ndarray:
    """Solve (H + second-difference terms) x = g, (t, s); held unknowns keep the identity's row."""
    frames, size = g.shape
    bands = np.zeros((2 * size + 1, frames * size))
    for below in range(size):
        rows = np.arange(size - below)
        bands[below].reshape(frames, size)[:, rows] = H[:, rows + below, rows]
    near, far, own = np.full(frames - 1, -4.0), np.ones(frames - 2), np.full(frames, 6.0)
    own[[0, -1]], near[[0, -1]] = 1.0, -2.0
    if frames > 3:
        own[[1, -2]] = 5.0
    else:
        own[1] = 4.0
    for offset, weight in ((0, own), (1, near), (2, far)):
        both = free[: frames - offset] * free[offset:]
        bands[offset * size].reshape(frames, size)[: frames - offset] += weight[:, None] * price * both
    return solveh_banded(bands, g.ravel(), lower=True).reshape(frames, size)


REST = 1e-7
"""weight (m/rad)^2 of the distance to the middle of a joint, which decides joints that the points do not determine"""


@dataclass(frozen=True)
class FitWeights:
    """Weights of the kinds of error, per metre, and of acceleration."""

    level_1: float
    level_2: float
    """middle and distal joints"""
    tips: float
    pinch: float
    """vectors from the thumb's tip to the other tips, where they are short"""
    pinch_m: float
    """length at which the weight of a pinch vector falls to 1/e"""
    acceleration_m: float
    """error that costs as much as 100 rad/s^2 of a joint or of the palm, or 10 m/s^2 of the palm"""


@dataclass(frozen=True, eq=False)
class FitState:
    """Pose of a hand in t frames."""

    palm: np.ndarray
    """(t, 4, 4) pose in the world"""
    motors: np.ndarray
    """(t, m) actuated joints, rad"""

    def moved(self, step: np.ndarray, low: np.ndarray, high: np.ndarray) -> FitState:
        """Return the state after a step (t, 6 + m), with motors clipped to their limits."""
        palm = self.palm.copy()
        palm[:, :3, 3] += step[:, :3]
        palm[:, :3, :3] = Rotation.from_rotvec(step[:, 3:6]).as_matrix() @ palm[:, :3, :3]
        return FitState(palm, np.clip(self.motors + step[:, 6:], low, high))


class RetargetProblem:
    """Weighted least-squares problem of a hand and its targets: errors and Jacobians."""

    def __init__(self, hand: HandModel, which: HandPoints, goal: Targets, weights: FitWeights) -> None:
        self.hand, self.which, self.goal, self.weights = hand, which, goal, weights
        roles = np.array([hand.joints.role[k] for k in commanded_joints(hand.joints)])
        A, self.offset = coupling_matrix(hand.joints)
        self.A = A[:, roles == "actuated"]
        moving, motors = moving_joints(hand.joints).tolist(), commanded_joints(hand.joints)[roles == "actuated"]
        self.low, self.high = joint_limits(hand.joints)[[moving.index(k) for k in motors]].T.copy()
        self.size = 6 + len(self.low)
        level = np.sqrt([weights.level_1, weights.level_2, weights.level_2, weights.tips])
        near = np.exp(-np.square(np.linalg.norm(goal.pinches_m, axis=-1) / weights.pinch_m))
        self.scale = np.concatenate([np.tile(level, (len(goal.palm), len(which.keypoint))), np.sqrt(weights.pinch * near)], axis=1)

    def start(self) -> FitState:
        """Return the initial state: the human palm, and every motor in the middle of its range."""
        return FitState(self.goal.palm, np.tile((self.low + self.high) / 2, (len(self.goal.palm), 1)))

    def q(self, state: FitState) -> np.ndarray:
        """Return q (t, d) with the wrist at rest."""
        found: np.ndarray = state.motors @ self.A.T + self.offset
        return found

    def points_of(self, state: FitState) -> np.ndarray:
        """Compute the points of the hand in the world frame, (t, 4 f, 3)."""
        return self._world(state, self._links(state)[1])

    def errors(self, state: FitState) -> np.ndarray:
        """Compute weighted errors in metres, (t, r), including the rest term."""
        return self._errors(state, self.points_of(state))

    def normal(self, state: FitState) -> tuple[np.ndarray, np.ndarray]:
        """Compute the normal equations: J^T J (t, s, s) and J^T e (t, s)."""
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

    def _links(self, state: FitState) -> tuple[np.ndarray, np.ndarray]:
        """Compute the poses of links with the wrist at rest, and the points in the palm frame."""
        T = forward_kinematics(self.hand.joints, self.q(state))
        return T, points_on_links(np.linalg.inv(T[:, self.hand.palm])[:, None] @ T, self.which.links, self.which.offsets_m)

    def _world(self, state: FitState, local: np.ndarray) -> np.ndarray:
        found: np.ndarray = np.einsum("tij,tkj->tki", state.palm[:, :3, :3], local) + state.palm[:, None, :3, 3]
        return found

    def _errors(self, state: FitState, ours: np.ndarray) -> np.ndarray:
        theirs = self.goal.points_m.reshape(ours.shape)
        tips = ours[:, TIP::OF_FINGER]
        errors = np.concatenate([ours - theirs, tips[:, 1:] - tips[:, :1] - self.goal.pinches_m], axis=1) * self.scale[..., None]
        rest = np.sqrt(REST) * (state.motors - (self.low + self.high) / 2)
        return np.concatenate([errors.reshape(len(ours), -1), rest], axis=1)


def _cross(rows: np.ndarray) -> np.ndarray:
    """Return the cross-product matrices of vectors, (..., 3) -> (..., 3, 3)."""
    out = np.zeros((*rows.shape, 3))
    x, y, z = np.moveaxis(rows, -1, 0)
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out
