"""Surface points with areas, and their visibility by ray casting (Embree, single precision)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from schemas.mesh import ObjectMesh

UNIT = 100.0
"""size to which objects are scaled, so that single precision is the same for a needle and a pan"""
LIFT = 2e-5
"""offset of ray origins above the surface, as a share of the object's size, against self-intersection"""
AT_ONCE = 1 << 20
"""rays in one call"""


class Rays:
    """Ray caster for the triangles of an object."""

    def __init__(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        """Build the scene of `vertices` (v, 3), metres, and `faces` (f, 3)."""
        low, high = vertices.min(0).astype(np.float64), vertices.max(0).astype(np.float64)
        self._centre, self._scale = (low + high) / 2, UNIT / max(float((high - low).max()), 1e-9)
        self._scene = EmbreeScene()
        TriangleMesh(self._scene, self._unit(vertices), np.ascontiguousarray(faces, np.int32))

    def escape(self, points: np.ndarray, normals: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Test rays from just above surface points (n, 3) along directions (n, 3): (n,) bool, True without a hit."""
        out = np.empty(len(points), bool)
        for at in range(0, len(points), AT_ONCE):
            part = slice(at, at + AT_ONCE)
            start = self._unit(points[part]) + np.float32(LIFT * UNIT) * normals[part].astype(np.float32)
            out[part] = self._scene.run(start, np.ascontiguousarray(directions[part], np.float32), query="OCCLUDED") == -1
        return out

    def first(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Find the face (n,) int32 that each ray from outside hits first, -1 for none."""
        out = np.empty(len(origins), np.int32)
        for at in range(0, len(origins), AT_ONCE):
            part = slice(at, at + AT_ONCE)
            out[part] = self._scene.run(self._unit(origins[part]), np.ascontiguousarray(directions[part], np.float32))
        return out

    def _unit(self, points: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray((points - self._centre) * self._scale, np.float32)


POINTS = 4096
"""approximate number of points; every face has at least one, and large faces have more"""
GRAZING_COS = np.float32(np.cos(np.radians(88)))
"""smallest cosine to the normal of a direction that sees a point"""


@dataclass(frozen=True, eq=False)
class Surface:
    """Surface points: (n, 3) float32 points and unit normals, (n,) face and area in m^2 of each."""

    points: np.ndarray
    normals: np.ndarray
    face: np.ndarray
    area: np.ndarray

    @staticmethod
    def of(mesh: ObjectMesh) -> Surface:
        """Place one point at the centre of each face; large faces are subdivided first."""
        corners = mesh.vertices[mesh.faces].astype(np.float64)
        area, normal = face_areas(corners)
        cuts = np.ceil(np.sqrt(area * POINTS / max(area.sum(), 1e-30))).clip(1, 256).astype(int)
        parts = [_spread(corners[cuts == n], np.flatnonzero(cuts == n), int(n)) for n in np.unique(cuts)]
        face = np.concatenate([part[1] for part in parts])
        order = np.argsort(face, kind="stable")
        points, face = np.concatenate([part[0] for part in parts])[order], face[order]
        return Surface(points.astype(np.float32), normal[face].astype(np.float32), face, (area / cuts**2)[face])

    def visible(self, rays: Rays, directions: np.ndarray) -> np.ndarray:
        """Find points (n,) bool from which a ray escapes along at least one of the (d, 3) directions."""
        out = np.zeros(len(self.points), bool)
        for towards in directions.astype(np.float32):
            facing = np.flatnonzero(~out & (self.normals @ towards > GRAZING_COS))
            out[facing] = rays.escape(self.points[facing], self.normals[facing], np.broadcast_to(towards, (len(facing), 3)))
        return out


def fibonacci_sphere(count: int) -> np.ndarray:
    """Spread (count, 3) float64 unit vectors evenly (Fibonacci lattice)."""
    n = np.arange(count) + 0.5
    z, turn = 1 - 2 * n / count, np.pi * (1 + 5**0.5) * n
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(turn), r * np.sin(turn), z], -1)


def face_areas(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute areas (f,) in m^2 and unit normals (f, 3) of triangles (f, 3, 3); 0 for degenerate ones."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1)
    return length / 2, cross / np.maximum(length, 1e-30)[:, None]


def _spread(corners: np.ndarray, face: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the centres of n * n equal triangles of each face (f, 3, 3), and the face of each."""
    cells = [(i, j, turned) for i in range(n) for j in range(n - i) for turned in (0, 1) if not turned or i + j < n - 1]
    weights = np.array([_middle(*cell, n) for cell in cells])
    points = np.einsum("wk,fkx->fwx", weights, corners)
    return points.reshape(-1, 3), np.repeat(face, len(weights))


def _middle(i: int, j: int, turned: int, n: int) -> tuple[float, float, float]:
    a, b = (i + (1 + turned) / 3) / n, (j + (1 + turned) / 3) / n
    return 1 - a - b, a, b
