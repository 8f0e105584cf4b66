"""Generalised advantage estimation (Schulman et al. 2016), over environments that end at different times."""

from __future__ import annotations

import numpy as np


def advantages(reward: np.ndarray, value: np.ndarray, after: np.ndarray, terminated: np.ndarray, ended: np.ndarray, gamma: float,
               lam: float) -> np.ndarray:  # fmt: skip
    """(t, n) advantages of t steps in n environments.

    `value` (t, n) of the observations that were acted on, `after` (t, n) of those that followed, before any reset. `terminated`
    (t, n): nothing follows, the value after is 0; `ended` (t, n): terminated or truncated, so that the next row is another episode.
    """
    surprise = reward + gamma * np.where(terminated, 0, after) - value
    out = np.zeros_like(surprise)
    ahead = np.zeros(surprise.shape[1:], surprise.dtype)
    for step in range(len(surprise) - 1, -1, -1):
        ahead = surprise[step] + gamma * lam * np.where(ended[step], 0, ahead)
        out[step] = ahead
    return out
