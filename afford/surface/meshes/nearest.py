"""Nearest points on a surface.

The surface is covered with dense samples, and the triangles of the nearest few samples are measured exactly. Coordinates are scaled
to a typical edge length, because trimesh treats values below 1e-12, and squared lengths too, as zero.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from trimesh.triangles import closest_point, points_to_barycentric

SAMPLES = 400_000
CANDIDATES = 6
CHUNK = 100_000


class NearestSurface:
    """Nearest point queries for (v, 3) vertices and (f, 3) faces."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        tri = vertices[faces].astype(np.float64)
        self.unit = max(float(np.linalg.norm(tri - np.roll(tri, -1, axis=1), axis=2).mean()), 1e-30)
        self.tri = tri / self.unit
        self.owner, points = _cover(self.tri)
        self.tree = cKDTree(points)

    def __call__(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Find face (n,), barycentric coordinates (n, 3) and distance (n,) of the nearest points to (n, 3) points."""
        parts = [self._ask(points[k : k + CHUNK] / self.unit) for k in range(0, len(points), CHUNK)]
        face, bary, distance = (np.concatenate(column) for column in zip(*parts, strict=True))
        return face, bary, distance * self.unit

    def _ask(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        few = min(CANDIDATES, len(self.owner))
        faces = self.owner[self.tree.query(points, few)[1].reshape(len(points), few)]
        places = closest_point(self.tri[faces.reshape(-1)], np.repeat(points, few, axis=0)).reshape(len(points), few, 3)
        away = np.linalg.norm(places - points[:, None], axis=2)
        row, best = np.arange(len(points)), away.argmin(axis=1)
        face, place = faces[row, best], places[row, best]
        bary = np.clip(points_to_barycentric(self.tri[face], place, method="cross"), 0, 1)
        return face, bary / bary.sum(axis=1, keepdims=True), away[row, best]


def _cover(tri: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sample all triangles: face and position of each sample. A face has k^2 samples, dense along its longest edge."""
    area = np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1) / 2
    longest = np.linalg.norm(tri - np.roll(tri, -1, axis=1), axis=2).max(axis=1)
    spacing = np.sqrt(area.sum() / SAMPLES)
    cuts = np.clip(np.ceil(longest / spacing / 2), 1, 256).astype(np.int64)
    owners, points = [], []
    for k in np.unique(cuts):
        mine = np.flatnonzero(cuts == k)
        weights = _grid(int(k))
        owners.append(np.repeat(mine, len(weights)))
        points.append(np.einsum("sc,fcx->fsx", weights, tri[mine]).reshape(-1, 3))
    return np.concatenate(owners), np.concatenate(points)


def _grid(k: int) -> np.ndarray:
    """Return the (k^2, 3) barycentric centres of the triangles of a triangle cut k times along each side."""
    up = [(i + 1 / 3, j + 1 / 3) for i in range(k) for j in range(k - i)]
    down = [(i + 2 / 3, j + 2 / 3) for i in range(k - 1) for j in range(k - 1 - i)]
    ij = np.array(up + down) / k
    return np.concatenate([ij, 1 - ij.sum(axis=1, keepdims=True)], axis=1)
