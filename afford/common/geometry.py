"""Geometry: surface sampling, farthest point sampling, and quaternions of single rotations.

The quaternion functions take one rotation (x y z w) at a time, as simulators need at every step; scipy and numpy calls are about
twenty times slower for that.
"""

from __future__ import annotations

import numpy as np


def sample_surface(vertices: np.ndarray, faces: np.ndarray, weight: np.ndarray, count: int,
           rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Sample points on a mesh, stratified, in proportion to a weight of each face.

    Returns (count, 3) float32 points and the face (count,) int32 of each. The number of points of a face differs from its share by
    at most one. The result is empty when no face has a weight.
    """
    total = np.cumsum(weight, dtype=np.float64)
    if not len(total) or total[-1] <= 0:
        return np.zeros((0, 3), np.float32), np.zeros(0, np.int32)
    at = (np.arange(count) + rng.random(count)) / count * total[-1]
    face = np.searchsorted(total, at, side="right").clip(0, np.flatnonzero(weight)[-1])
    a, b = rng.random((2, count))
    flip = a + b > 1
    a, b = np.where(flip, 1 - a, a), np.where(flip, 1 - b, b)
    corner = vertices[faces[face]].astype(np.float64)
    points = corner[:, 0] + a[:, None] * (corner[:, 1] - corner[:, 0]) + b[:, None] * (corner[:, 2] - corner[:, 0])
    return points.astype(np.float32), face.astype(np.int32)


def farthest_point_sampling(points: np.ndarray, count: int) -> np.ndarray:
    """Return (k,) int64 indices of farthest point sampling, k = min(count, n).

    The first point is the one farthest from the mean; each next point is the one farthest from those already chosen.
    """
    if not len(points) or not count:
        return np.zeros(0, np.int64)
    spots = points.astype(np.float64)
    taken = np.empty(min(count, len(spots)), np.int64)
    taken[0] = ((spots - spots.mean(0)) ** 2).sum(1).argmax()
    near = ((spots - spots[taken[0]]) ** 2).sum(1)
    for n in range(1, len(taken)):
        taken[n] = near.argmax()
        near = np.minimum(near, ((spots - spots[taken[n]]) ** 2).sum(1))
    return taken


def quaternion_matrix(quaternion: np.ndarray) -> np.ndarray:
    """Convert a unit quaternion (4,) to a rotation matrix (3, 3)."""
    x, y, z, w = map(float, quaternion)
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])  # fmt: skip


def cross(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Compute the cross product of two vectors (3,)."""
    a, b, c = map(float, first)
    x, y, z = map(float, second)
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def quaternion_product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Compose two rotations (4,): first `second`, then `first`."""
    a, b, c, d = map(float, first)
    x, y, z, w = map(float, second)
    return np.array([d * x + a * w + b * z - c * y, d * y - a * z + b * w + c * x,
                     d * z + a * y - b * x + c * w, d * w - a * x - b * y - c * z])  # fmt: skip


def quaternion_inverse(quaternion: np.ndarray) -> np.ndarray:
    """Invert a unit quaternion (4,)."""
    found: np.ndarray = np.asarray(quaternion, np.float64) * (-1.0, -1.0, -1.0, 1.0)
    return found
