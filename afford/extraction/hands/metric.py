"""Metric hand keypoints: perspective placement of a model's 3-D keypoints by their image, and smoothing over time.

The scale comes from two assumptions: the size of the hand and the field of view of the camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.extraction.hands.hand_fit import BONES, CHAINS, fit_to_image

PALM = (0, 5, 9, 13, 17)
"""wrist and knuckles"""
FINGERS = 0.1
"""weight of the image points of fingers against those of the palm: hidden fingers are guesses of a landmark model"""
ROUNDS = 8
"""iterations of the robust placement"""
OUTLIER = 3.0
"""residual, in median residuals, beyond which a keypoint loses weight"""
LEAST_M = 0.05
"""smallest distance of a hand from the camera, metres"""


@dataclass(frozen=True)
class Lifting:
    """Assumptions and smoothing of metric keypoints."""

    hand_m: float = 0.19
    """assumed length of the hand, from the wrist to the tip of the middle finger; all distances are proportional to it"""
    noise_px: float = 0.01
    """standard deviation of the position of a hand in the image, as a share of its size there"""
    noise_depth: float = 0.1
    """standard deviation of the distance from the camera in one frame, as a share of it"""
    noise_pose_m: float = 0.015
    """standard deviation of keypoints relative to the hand's centre"""
    acceleration_m_s2: float = 2.0
    """standard deviation of the acceleration of a hand; 0 switches smoothing off"""
    gap_s: float = 0.35
    """longest time without keypoints within one smoothed run"""


def focal_px(width_px: int, height_px: int, fov_deg: float) -> float:
    """Compute the focal length of a pinhole camera with square pixels; `fov_deg` is the angle across the longer image side.

    Raises ValueError when the angle is outside 10 to 170 degrees.
    """
    if not 10 <= fov_deg <= 170:
        raise ValueError(f"fov_deg: expected 10 to 170 degrees across the longer side of the picture, got {fov_deg:g}")
    return float(0.5 * max(width_px, height_px) / np.tan(np.radians(fov_deg) / 2))


def camera_matrix(width_px: int, height_px: int, focal: float) -> np.ndarray:
    """Return K (3, 3) with the principal point in the middle of the image."""
    return np.array([[focal, 0, (width_px - 1) / 2], [0, focal, (height_px - 1) / 2], [0, 0, 1.0]])


def lift(keypoints_px: np.ndarray, keypoints_m: np.ndarray, confidence: np.ndarray, time_s: np.ndarray, K: np.ndarray,
         params: Lifting) -> np.ndarray:  # fmt: skip
    """Compute the keypoints (t, 21, 3) float32 of one hand in the camera frame (x right, y down, z away), in metres.

    keypoints_px: (t, 21, 2). keypoints_m: (t, 21, 3), origin and size free, axes of a camera that faces the hand. confidence:
    (t,) or (t, 21), 0 where a frame has no keypoints; these frames are 0 in the result. time_s: (t,), ascending. Every bone has
    the length that a hand of `hand_m` gives it. Runs of frames that are more than `gap_s` apart are smoothed separately.
    """
    weight = np.broadcast_to(confidence[:, None], (len(confidence), 21)) if confidence.ndim == 1 else confidence
    shown = np.flatnonzero((weight > 0).any(axis=1))
    out = np.zeros((len(weight), 21, 3), np.float32)
    if not len(shown):
        return out
    weight = weight[shown].astype(float)
    rays = _rays(keypoints_px[shown], K)
    shape = _with_lengths(_facing(keypoints_m[shown].astype(float), rays, weight), params.hand_m * BONES)
    place = _place(shape, rays, weight)
    placed = shape + place[:, None]
    palm = weight * np.where(np.isin(np.arange(21), PALM), 1, FINGERS)
    fitted = fit_to_image(placed, rays, palm * _inliers(_beside(placed, rays)), params.hand_m)
    shape = _with_lengths(fitted, params.hand_m * BONES)
    place = _place(shape, rays, palm)
    for run in _runs(time_s[shown], params.gap_s):
        out[shown[run]] = _smoothed(shape[run], place[run], weight[run], time_s[shown[run]], K, params)
    return out


def smooth(values: np.ndarray, time_s: np.ndarray, noise: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Smooth values (t, c) by a Rauch-Tung-Striebel smoother of constant velocity.

    noise: standard deviation (t, c) of each value. acceleration: (c,) standard deviation of the acceleration that lasts from
    one frame to the next, in units of the values per s^2.
    """
    count, channels = values.shape
    state, cov = np.zeros((count, channels, 2)), np.zeros((count, channels, 2, 2))
    guess, spread = np.zeros_like(state), np.zeros_like(cov)
    steps = np.diff(time_s)
    for k in range(count):
        if k == 0:
            guess[0, :, 0], spread[0] = values[0], _diagonal(noise[0] * 1e3, _reach(values, time_s))
        else:
            F, Q = _motion(steps[k - 1], acceleration)
            guess[k], spread[k] = state[k - 1] @ F.T, F @ cov[k - 1] @ F.T + Q
        gain = spread[k, :, :, 0] / (spread[k, :, 0, 0] + noise[k] ** 2)[:, None]
        state[k] = guess[k] + gain * (values[k] - guess[k, :, 0])[:, None]
        cov[k] = spread[k] - gain[:, :, None] * spread[k, :, None, 0, :]
    for k in range(count - 2, -1, -1):
        F, _ = _motion(steps[k], acceleration)
        back = cov[k] @ F.T @ np.linalg.inv(spread[k + 1])
        state[k] += np.einsum("cij,cj->ci", back, state[k + 1] - guess[k + 1])
    smoothed: np.ndarray = state[:, :, 0]
    return smoothed


def _rays(keypoints_px: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Return the directions (t, 21, 2) of image points at depth 1."""
    rays: np.ndarray = (keypoints_px.astype(float) - K[:2, 2]) / (K[0, 0], K[1, 1])
    return rays


def _facing(shape: np.ndarray, rays: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Rotate keypoints (t, 21, 3) of cameras that face the hand into the axes of the camera that took the picture."""
    middle = np.einsum("tk,tkc->tc", weight, rays) / weight.sum(axis=1, keepdims=True)
    ahead = np.concatenate([middle, np.ones((len(middle), 1))], axis=1)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    x, y, z = ahead.T
    zero = np.zeros_like(x)
    cross = np.stack([np.stack([zero, zero, x], -1), np.stack([zero, zero, y], -1), np.stack([-x, -y, zero], -1)], axis=1)
    turn = np.eye(3) + cross + cross @ cross / (1 + z)[:, None, None]
    return np.einsum("tij,tkj->tki", turn, shape)


def _with_lengths(shape: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Set the lengths (5, 4) of all bones of keypoints (t, 21, 3), which keep their directions; the palm's centre is the origin."""
    bones = np.diff(shape[:, CHAINS, :], axis=2)
    bones *= (lengths / np.maximum(np.linalg.norm(bones, axis=-1), 1e-9))[..., None]
    out = np.zeros_like(shape)
    out[:, 1:] = np.cumsum(bones, axis=2).reshape(len(shape), 20, 3)
    centred: np.ndarray = out - out[:, PALM, :].mean(axis=1, keepdims=True)
    return centred


def _place(shape: np.ndarray, rays: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Compute the translation (t, 3) that projects keypoints (t, 21, 3) onto rays (t, 21, 2) with the least robust error."""
    robust = weight
    for _ in range(ROUNDS):
        place = _least_squares(shape, rays, robust)
        robust = weight * _inliers(_beside(shape + place[:, None], rays))
    return place


def _beside(placed: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """Return the offsets (t, 21, 2), in metres, of placed keypoints from their rays at the same depth."""
    offsets: np.ndarray = placed[..., :2] - rays * placed[..., 2:]
    return offsets


def _inliers(beside: np.ndarray) -> np.ndarray:
    """Return a weight (t, 21) of 1 that falls for keypoints farther from their rays than others."""
    error = np.linalg.norm(beside, axis=-1)
    limit = OUTLIER * np.maximum(np.median(error, axis=1, keepdims=True), 1e-9)
    weight: np.ndarray = limit / np.maximum(error, limit)
    return weight


def _least_squares(shape: np.ndarray, rays: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Solve x + tx = u (z + tz), y + ty = v (z + tz) for (tx, ty, tz) in every frame."""
    wanted = rays * shape[..., 2:] - shape[..., :2]
    total = weight.sum(axis=1)[:, None]
    ray, goal = (np.einsum("tk,tkc->tc", weight, part) / total for part in (rays, wanted))
    across, beside = rays - ray[:, None], wanted - goal[:, None]
    depth = -np.einsum("tk,tkc,tkc->t", weight, across, beside) / np.einsum("tk,tkc,tkc->t", weight, across, across)
    depth = np.maximum(depth, LEAST_M)
    return np.concatenate([goal + ray * depth[:, None], depth[:, None]], axis=1)


def _runs(time_s: np.ndarray, gap_s: float) -> list[np.ndarray]:
    """Split frames where they are more than `gap_s` apart."""
    return np.split(np.arange(len(time_s)), np.flatnonzero(np.diff(time_s) > gap_s) + 1)


def _smoothed(shape: np.ndarray, place: np.ndarray, weight: np.ndarray, time_s: np.ndarray, K: np.ndarray,
              params: Lifting) -> np.ndarray:  # fmt: skip
    """Smooth one run: direction and log distance of the hand, and its shape, whose bones keep their lengths."""
    if params.acceleration_m_s2 <= 0 or len(place) < 3:
        return shape + place[:, None]
    depth = np.median(place[:, 2])
    doubt = 1 / np.sqrt(np.clip(weight.mean(axis=1, keepdims=True), 0.05, 1))
    seen = np.concatenate([place[:, :2] / place[:, 2:], np.log(place[:, 2:])], axis=1)
    noise = doubt * np.array([params.noise_px * params.hand_m / depth] * 2 + [params.noise_depth])
    moved = smooth(seen, time_s, noise, np.full(3, params.acceleration_m_s2 / depth))
    z = np.exp(moved[:, 2:])
    flat = shape.reshape(len(shape), -1)
    pose = smooth(flat, time_s, np.broadcast_to(doubt * params.noise_pose_m, flat.shape),
                  np.full(flat.shape[1], params.acceleration_m_s2)).reshape(shape.shape)
    return _with_lengths(pose, params.hand_m * BONES) + np.concatenate([moved[:, :2] * z, z], axis=1)[:, None]


def _motion(step_s: float, acceleration: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the transition (2, 2) of position and velocity, and its noise (c, 2, 2)."""
    push = np.array([step_s**2 / 2, step_s])
    return np.array([[1.0, step_s], [0.0, 1.0]]), np.outer(push, push) * (acceleration**2)[:, None, None]


def _reach(values: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Return a wide standard deviation (c,) of the first velocity."""
    reach: np.ndarray = 10 * (np.ptp(values, axis=0) + 1e-6) / max(time_s[-1] - time_s[0], 1e-3)
    return reach


def _diagonal(position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """Return covariances (c, 2, 2) of independent positions and velocities."""
    out = np.zeros((len(position), 2, 2))
    out[:, 0, 0], out[:, 1, 1] = position**2, velocity**2
    return out
