"""The fast global smoother (Min et al. 2014): weighted least squares on the image grid, by exact one-dimensional solves.

It minimises sum w (u - f)^2 + smoothness * sum affinity |difference of neighbours of u|^2, alternating rows and columns. Where
the weight is 0 nothing is believed, and what neighbours of the same surface say comes in.
"""

from __future__ import annotations

import numba
import numpy as np

ROUNDS = 3
TINY = np.float32(1e-6)


def affinity(guide: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How much neighbours belong together, 0..1: along rows (h, w - 1) and, transposed, along columns (w, h - 1).

    `guide` is (h, w, c) float32, scaled so that a difference of 1 parts two pixels (e^-1).
    """
    rows = np.exp(-np.abs(np.diff(guide, axis=1)).sum(-1))
    columns = np.exp(-np.abs(np.diff(guide, axis=0)).sum(-1)).T
    return rows.astype(np.float32), np.ascontiguousarray(columns.astype(np.float32))


def smooth(values: np.ndarray, weight: np.ndarray, near: tuple[np.ndarray, np.ndarray], smoothness: float) -> np.ndarray:
    """(h, w, c) float32 values, believed by `weight` (h, w) >= 0, spread within what `near` (`affinity`) says belongs together.

    Where nothing that is believed can be reached, the values come near the believed mean.
    """
    believed = np.maximum(weight, TINY)[..., None].astype(np.float32)
    mean = (values * believed).sum((0, 1)) / believed.sum()
    both = np.concatenate([(values - mean) * believed, believed], -1).astype(np.float32)
    for turn in range(ROUNDS):
        strength = np.float32(smoothness * 1.5 * 4.0 ** (ROUNDS - 1 - turn) / (4.0**ROUNDS - 1))
        solve(both, near[0], strength)
        across = np.ascontiguousarray(both.swapaxes(0, 1))
        solve(across, near[1], strength)
        both = np.ascontiguousarray(across.swapaxes(0, 1))
    return both[..., :-1] / both[..., -1:] + mean


@numba.njit(cache=True)
def solve(values, near, strength):  # type: ignore[no-untyped-def]  # numba infers
    """Every row of `values` (n, m, c) in place: (1 + strength * (links)) u - strength * links * neighbours = values (Thomas)."""
    count, length, channels = values.shape
    upper = np.empty(length, np.float32)
    for row in range(count):
        left = np.float32(0.0)
        carry = np.float32(0.0)
        for n in range(length):
            right = strength * near[row, n] if n + 1 < length else np.float32(0.0)
            pivot = np.float32(1.0) / (np.float32(1.0) + left + right - left * carry)
            for c in range(channels):
                before = left * values[row, n - 1, c] if n > 0 else np.float32(0.0)
                values[row, n, c] = (values[row, n, c] + before) * pivot
            carry = right * pivot
            upper[n] = carry
            left = right
        for n in range(length - 2, -1, -1):
            for c in range(channels):
                values[row, n, c] += upper[n] * values[row, n + 1, c]
