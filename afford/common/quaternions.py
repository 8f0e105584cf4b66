"""Rotations (x y z w) and vectors one at a time, as a world needs at every step; scipy and numpy cost twenty times as much here."""

from __future__ import annotations

import numpy as np


def quaternion_matrix(quaternion: np.ndarray) -> np.ndarray:
    """(4,) unit quaternion -> (3, 3)."""
    x, y, z, w = map(float, quaternion)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])  # fmt: skip


def cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(3,) vector product."""
    a, b, c = map(float, first)
    x, y, z = map(float, second)
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def quaternion_product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(4,) that turns by `second`, then by `first`."""
    a, b, c, d = map(float, first)
    x, y, z, w = map(float, second)
    return np.array([d * x + a * w + b * z - c * y, d * y - a * z + b * w + c * x,
                     d * z + a * y - b * x + c * w, d * w - a * x - b * y - c * z])  # fmt: skip


def quaternion_inverse(quaternion: np.ndarray) -> np.ndarray:
    """(4,) of a unit quaternion."""
    found: np.ndarray = np.asarray(quaternion, np.float64) * (-1.0, -1.0, -1.0, 1.0)
    return found
