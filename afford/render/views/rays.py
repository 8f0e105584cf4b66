"""What is hidden from where: rays against the triangles of an object (Embree, single precision)."""

from __future__ import annotations

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

UNIT = 100.0
"""objects are scaled to about this size, so that single precision means the same for a needle and for a pan"""
LIFT = 2e-5
"""rays start this share of the object's size above the surface, so that they do not hit what they leave"""
AT_ONCE = 1 << 20
"""rays in one call"""


class Rays:
    """The triangles of an object, ready to be asked."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        """`vertices` (v, 3) metres, `faces` (f, 3)."""
        low, high = vertices.min(0).astype(np.float64), vertices.max(0).astype(np.float64)
        self._centre, self._scale = (low + high) / 2, UNIT / max(float((high - low).max()), 1e-9)
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, self._unit(vertices), np.ascontiguousarray(faces, np.int32))

    def escape(self, points: np.ndarray, normals: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(n,) bool: whether a ray from just above each surface point (n, 3) leaves along its direction (n, 3) without a hit."""
        out = np.empty(len(points), bool)
        for at in range(0, len(points), AT_ONCE):
            part = slice(at, at + AT_ONCE)
            start = self._unit(points[part]) + np.float32(LIFT * UNIT) * normals[part].astype(np.float32)
            out[part] = self._scene.run(start, np.ascontiguousarray(directions[part], np.float32), query="OCCLUDED") == -1
        return out

    def first(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(n,) int32 face that each ray from outside hits first, -1 for none."""
        out = np.empty(len(origins), np.int32)
        for at in range(0, len(origins), AT_ONCE):
            part = slice(at, at + AT_ONCE)
            out[part] = self._scene.run(self._unit(origins[part]), np.ascontiguousarray(directions[part], np.float32))
        return out

    def _unit(self, points: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray((points - self._centre) * self._scale, np.float32)
