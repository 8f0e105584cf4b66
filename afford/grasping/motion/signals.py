"""Speeds as AffordDex's imitation has them: the gradient in time, smoothed by a Gaussian of two frames."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

SIGMA_FRAMES = 2.0


def speed(values: np.ndarray, rate_hz: float, sigma_frames: float = SIGMA_FRAMES) -> np.ndarray:
    """(t, ...) -> (t, ...) change a second; 0 for a single frame."""
    if len(values) < 2:
        return np.zeros_like(values)
    return _smooth(np.gradient(values, axis=0) * rate_hz, sigma_frames)


def twist(T: np.ndarray, rate_hz: float, sigma_frames: float = SIGMA_FRAMES) -> np.ndarray:
    """(t, 4, 4) -> (t, 6) linear, then angular velocity in the world's axes; 0 for a single frame."""
    if len(T) < 2:
        return np.zeros((len(T), 6))
    R = T[:, :3, :3]
    steps = Rotation.from_matrix(R[1:] @ np.swapaxes(R[:-1], 1, 2)).as_rotvec()
    both = np.concatenate([steps[:1], (steps[1:] + steps[:-1]) / 2, steps[-1:]])
    return np.concatenate([speed(T[:, :3, 3], rate_hz, sigma_frames), _smooth(both * rate_hz, sigma_frames)], axis=1)


def _smooth(values: np.ndarray, sigma_frames: float) -> np.ndarray:
    smoothed: np.ndarray = gaussian_filter1d(values, sigma_frames, axis=0, mode="nearest") if sigma_frames > 0 else values
    return smoothed
