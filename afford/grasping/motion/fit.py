"""Levenberg-Marquardt for all frames of a clip: first each alone, then all together with a price on acceleration.

Motors stay within their limits exactly: steps are cut there, and a motor that would leave stays (projected Gauss-Newton).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded
from scipy.spatial.transform import Rotation

from afford.grasping.motion.problem import Problem, State

DAMPING, DAMPING_RANGE = 1e-3, (1e-9, 1e6)
ENOUGH = 1e-7
"""a gain of less than this share of the cost ends the fit"""


def fit_frames(problem: Problem, steps: int) -> State:
    """Every frame alone, from the middle of its joints; each has its own damping."""
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
        state = State(np.where(better[:, None, None], tried.palm, state.palm),
                      np.where(better[:, None], tried.motors, state.motors))
        cost = np.where(better, new, cost)
        damping = np.clip(np.where(better, damping / 5, damping * 4), *DAMPING_RANGE)
    return state


def fit_clip(problem: Problem, state: State, rate_hz: float, steps: int) -> State:
    """All frames together, from what each is alone; a clip of fewer than three has no acceleration and stays as it is."""
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


def _held(problem: Problem, state: State, H: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Motors at a limit that want to go beyond keep still: their rows and columns become those of the identity. Also
    (t, s) 1 where free, else 0.
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


def _prices(problem: Problem, rate_hz: float) -> np.ndarray:
    """(s,) weight of a squared second difference between frames."""
    each = np.full(problem.size, 100.0)
    each[:3] = 10.0
    return np.square(problem.weights.acceleration_m * rate_hz**2 / each)


def _second(state: State) -> np.ndarray:
    """(t - 2, s) second differences; turns of the palm in the world."""
    R = state.palm[:, :3, :3]
    turn = Rotation.from_matrix(R[1:] @ np.swapaxes(R[:-1], 1, 2)).as_rotvec()
    palm, motors = np.diff(state.palm[:, :3, 3], 2, axis=0), np.diff(state.motors, 2, axis=0)
    return np.concatenate([palm, np.diff(turn, axis=0), motors], axis=1)


def _transposed(second: np.ndarray) -> np.ndarray:
    """(t - 2, s) -> (t, s): the slope of half the squared second differences."""
    out = np.zeros((len(second) + 2, second.shape[1]))
    out[:-2] += second
    out[1:-1] -= 2 * second
    out[2:] += second
    return out


def _clip_cost(problem: Problem, state: State, price: np.ndarray) -> float:
    return float(np.square(problem.errors(state)).sum() + (price * np.square(_second(state))).sum())


def _solve_banded(H: np.ndarray, g: np.ndarray, free: np.ndarray, price: np.ndarray) -> np.ndarray:
    """Solve (H + the second differences') x = g, (t, s); entries that are not free keep the identity's row."""
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
