"""Triangle meshes for rendering, with texture coordinates and smooth or creased normals.

Vertices are (v, 3) float32 in metres, faces (f, 3) int32 counter-clockwise seen from outside, uv (v, 2) float32.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numba
import numpy as np


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangle mesh; `normals` (v, 3) float32 unit, `colour` (v, 3) float32 multiplies the texture."""

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    normals: np.ndarray
    colour: np.ndarray

    @property
    def bounds(self) -> np.ndarray:
        """Lowest and highest corner (2, 3), metres."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])


def mesh(vertices: np.ndarray, faces: np.ndarray, uv: np.ndarray | None = None, *, crease_deg: float = 40.0) -> Mesh:
    """Build a mesh whose vertices are split where two faces meet at more than `crease_deg`.

    Normals of vertices at the same position are averaged even when their uv differ, so that texture seams do not show.
    """
    points = np.ascontiguousarray(vertices, np.float32)
    corners = np.ascontiguousarray(faces, np.int32)
    coords = np.zeros((len(points), 2), np.float32) if uv is None else np.ascontiguousarray(uv, np.float32)
    corners = corners[has_area(points, corners)]
    normals = _corner_normals(points, corners, np.float32(np.cos(np.radians(crease_deg))))
    keys = np.concatenate([corners.reshape(-1, 1), np.round(normals.reshape(-1, 3) * 512).astype(np.int32)], axis=1)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    source = corners.reshape(-1)[first]
    split = inverse.reshape(-1, 3).astype(np.int32)
    colour = np.ones((len(source), 3), np.float32)
    return Mesh(points[source], split, coords[source], normals.reshape(-1, 3)[first], colour)


def has_area(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Find faces (f,) bool with an area; `mesh` drops the others."""
    return np.asarray(_area_normals(points, faces)[1] > 1e-14)


def _area_normals(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    tri = points[faces].astype(np.float64)
    normal = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    return normal, np.linalg.norm(normal, axis=1)


def _corner_normals(points: np.ndarray, faces: np.ndarray, cos_crease: np.float32) -> np.ndarray:
    """Compute normals (f, 3, 3): area-weighted means of the faces around a position that are flat enough."""
    normal, length = _area_normals(points, faces)
    _, place = np.unique(np.round(points * 2e5).astype(np.int64), axis=0, return_inverse=True)
    where = place.reshape(-1)[faces].reshape(-1)
    order = np.argsort(where, kind="stable")
    start = np.searchsorted(where[order], np.arange(where.max() + 2))
    unit = normal / np.maximum(length, 1e-30)[:, None]
    return _average(normal, unit, where, order, start, cos_crease)


@numba.njit(cache=True)
def _average(normal, unit, where, order, start, cos_crease):  # type: ignore[no-untyped-def]  # numba infers
    out = np.zeros((len(unit), 3, 3), np.float32)
    for corner in range(len(where)):
        face = corner // 3
        total = np.zeros(3)
        for k in range(start[where[corner]], start[where[corner] + 1]):
            other = order[k] // 3
            if (unit[face] * unit[other]).sum() >= cos_crease:
                total += normal[other]
        out[face, corner % 3] = total / max(np.sqrt((total * total).sum()), 1e-30)
    return out


def smooth_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute area-weighted vertex normals (v, 3) float32 without creases, for skinned meshes."""
    normal, _ = _area_normals(vertices, faces)
    total = np.stack([np.bincount(faces.reshape(-1), np.repeat(normal[:, k], 3), len(vertices)) for k in range(3)], axis=1)
    return (total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-30)).astype(np.float32)


def transform(shape: Mesh, T: np.ndarray) -> Mesh:
    """Apply a (4, 4) similarity `T`; the faces of a mirrored mesh are flipped."""
    linear = T[:3, :3]
    normals = shape.normals @ np.linalg.inv(linear).astype(np.float32)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    faces = shape.faces if np.linalg.det(linear) > 0 else np.ascontiguousarray(shape.faces[:, ::-1])
    points = shape.vertices @ linear.T.astype(np.float32) + T[:3, 3].astype(np.float32)
    return replace(shape, vertices=points.astype(np.float32), normals=normals.astype(np.float32), faces=faces)


def translate(shape: Mesh, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Mesh:
    """Shift a mesh by metres."""
    return replace(shape, vertices=shape.vertices + np.array([x, y, z], np.float32))


def merge(*shapes: Mesh) -> Mesh:
    """Merge meshes into one."""
    offsets = np.cumsum([0] + [len(s.vertices) for s in shapes[:-1]])
    faces = np.concatenate([s.faces + np.int32(o) for s, o in zip(shapes, offsets, strict=True)])
    join = {name: np.concatenate([getattr(s, name) for s in shapes]) for name in ("vertices", "uv", "normals", "colour")}
    return Mesh(faces=faces, **join)
