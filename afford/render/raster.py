"""Z-buffer rasteriser on homogeneous edge functions: the triangle and depth of every sample.

Every triangle becomes a (3, 3) matrix E with E @ (x, y, 1) = barycentrics / depth at image point (x, y) (Olano and Greer 1997).
Triangles that cross the camera plane need no clipping, and interpolation is perspective-correct.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from afford.render.scene import BACKGROUND, Batch, Camera

NEAR_M = 0.02
SEAM = -1e-9
"""samples this far outside an edge still count, so that rounding leaves no gap between neighbours"""


def project(vertices: np.ndarray, camera: Camera) -> np.ndarray:
    """Project (v, 3) world metres to (v, 3) homogeneous pixels (x * depth, y * depth, depth)."""
    T = np.linalg.inv(camera.T_world_cam)
    P = camera.K @ T[:3]
    return vertices @ P[:, :3].T + P[:, 3]


@numba.njit(cache=True, fastmath=True)
def edges(points, faces, width, height):  # type: ignore[no-untyped-def]  # numba infers
    """Compute edge matrices (f, 3, 3) float64 and pixel boxes (f, 4) int32.

    A box is x0, y0, x1, y1, ends exclusive; it is empty for a triangle outside the image.
    """
    count = len(faces)
    E = np.zeros((count, 3, 3))
    bounds = np.zeros((count, 4), np.int32)
    for f in range(count):
        a, b, c = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
        x0, y0, x1, y1 = _bounds(a, b, c)
        if x0 > x1 or x1 < 0 or y1 < 0 or x0 > width - 1 or y0 > height - 1:
            continue
        n0x, n0y, n0z = b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]
        det = a[0] * n0x + a[1] * n0y + a[2] * n0z
        if abs(det) < 1e-12:
            continue
        inv = 1.0 / det
        E[f, 0, 0], E[f, 0, 1], E[f, 0, 2] = n0x * inv, n0y * inv, n0z * inv
        E[f, 1, 0] = (c[1] * a[2] - c[2] * a[1]) * inv
        E[f, 1, 1] = (c[2] * a[0] - c[0] * a[2]) * inv
        E[f, 1, 2] = (c[0] * a[1] - c[1] * a[0]) * inv
        E[f, 2, 0] = (a[1] * b[2] - a[2] * b[1]) * inv
        E[f, 2, 1] = (a[2] * b[0] - a[0] * b[2]) * inv
        E[f, 2, 2] = (a[0] * b[1] - a[1] * b[0]) * inv
        bounds[f, 0], bounds[f, 1] = max(0, int(np.ceil(x0 - 1))), max(0, int(np.ceil(y0 - 1)))
        bounds[f, 2], bounds[f, 3] = min(width, int(x1) + 2), min(height, int(y1) + 2)
    return E, bounds


@numba.njit(cache=True, fastmath=True)
def _bounds(a, b, c):  # type: ignore[no-untyped-def]
    """Compute the image box of a triangle that is cut at the near plane."""
    x0, y0, x1, y1 = 1e9, 1e9, -1e9, -1e9
    for k in range(3):
        p = a if k == 0 else (b if k == 1 else c)
        q = b if k == 0 else (c if k == 1 else a)
        if p[2] >= NEAR_M:
            x, y = p[0] / p[2], p[1] / p[2]
            x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
        if (p[2] >= NEAR_M) != (q[2] >= NEAR_M):
            t = (NEAR_M - p[2]) / (q[2] - p[2])
            x, y = (p[0] + t * (q[0] - p[0])) / NEAR_M, (p[1] + t * (q[1] - p[1])) / NEAR_M
            x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
    return max(x0, -1e6), max(y0, -1e6), min(x1, 1e6), min(y1, 1e6)


@numba.njit(cache=True, fastmath=True)
def fill(E, bounds, first, last, supersample, nearness, seen):  # type: ignore[no-untyped-def]
    """Rasterise triangles first..last into `nearness` (H, W) float32 and `seen` (H, W) int32.

    `nearness` is 1 / depth (0 is empty), `seen` the triangle index. The arrays are `supersample` times the image size; sample i is
    at pixel coordinate (i + .5) / supersample - .5.
    """
    height, width = nearness.shape
    step = 1.0 / supersample
    limit = 1.0 / NEAR_M
    for f in range(first, last):
        if bounds[f, 2] <= bounds[f, 0]:
            continue
        x_low = max(0, bounds[f, 0] * supersample)
        x_high = min(width, bounds[f, 2] * supersample)
        a0, b0, c0 = E[f, 0, 0], E[f, 1, 0], E[f, 2, 0]
        total = a0 + b0 + c0
        for row in range(max(0, bounds[f, 1] * supersample), min(height, bounds[f, 3] * supersample)):
            y = (row + 0.5) * step - 0.5
            x = (x_low + 0.5) * step - 0.5
            a = a0 * x + E[f, 0, 1] * y + E[f, 0, 2]
            b = b0 * x + E[f, 1, 1] * y + E[f, 1, 2]
            c = c0 * x + E[f, 2, 1] * y + E[f, 2, 2]
            for column in range(x_low, x_high):
                t = (column - x_low) * step
                near = a + b + c + total * t
                if a + a0 * t >= SEAM and b + b0 * t >= SEAM and c + c0 * t >= SEAM and limit > near > nearness[row, column]:
                    nearness[row, column] = near
                    seen[row, column] = f


Seen = tuple[np.ndarray, np.ndarray]
"""triangle index (int32, -1 none) and 1 / depth (float32) of every sample"""


@dataclass(frozen=True, eq=False)
class View:
    """Batch of instances seen by a camera: edge matrices and pixel boxes of its triangles, faces of each part.

    Some entities can be drawn last, so that one pass gives the visible triangles with and without them.
    """

    scene: Batch
    camera: Camera
    E: np.ndarray
    bounds: np.ndarray
    starts: np.ndarray

    @staticmethod
    def of(scene: Batch, camera: Camera) -> View:
        """Project every triangle once."""
        E, bounds = edges(project(scene.vertices, camera), scene.faces, camera.width, camera.height)
        return View(scene, camera, E, bounds, np.searchsorted(scene.part, np.arange(len(scene.entity) + 1)))

    def seen(self, supersample: int, last: frozenset[int] = frozenset()) -> tuple[Seen, Seen]:
        """Rasterise without the entities in `last`, and with all entities."""
        shape = (self.camera.height * supersample, self.camera.width * supersample)
        near, face = np.zeros(shape, np.float32), np.full(shape, -1, np.int32)
        late = np.isin(self.scene.entity, list(last))
        self._draw(np.flatnonzero(~late), supersample, near, face)
        if not late.any():
            return (face, near), (face, near)
        without = (face.copy(), near.copy())
        self._draw(np.flatnonzero(late), supersample, near, face)
        return without, (face, near)

    def alone(self, entity: int) -> np.ndarray:
        """Rasterise one entity alone: its amodal mask (h, w) bool."""
        near = np.zeros((self.camera.height, self.camera.width), np.float32)
        face = np.full(near.shape, -1, np.int32)
        self._draw(np.flatnonzero(self.scene.entity == entity), 1, near, face)
        return face >= 0

    def ids(self, face: np.ndarray) -> np.ndarray:
        """Map triangle indices to entities (h, w) int16."""
        return np.append(self.scene.entity[self.scene.part], np.int16(BACKGROUND))[face]

    def _draw(self, parts: np.ndarray, supersample: int, near: np.ndarray, face: np.ndarray) -> None:
        for k in parts:
            fill(self.E, self.bounds, self.starts[k], self.starts[k + 1], supersample, near, face)


def depth(near: np.ndarray) -> np.ndarray:
    """Convert 1 / depth to depth in metres; 0 for empty samples."""
    return np.where(near > 0, 1.0 / np.maximum(near, 1e-9), 0.0).astype(np.float32)
