"""Solids of household objects: lathed, boxed, swept, extruded. One uv unit is one texture."""

from __future__ import annotations

import numpy as np

from afford.render.mesh import Mesh, mesh


def grid_faces(rows: int, columns: int) -> np.ndarray:
    """Triangulate a (rows, columns) grid of vertices, row-major: (f, 3) int32.

    The outside is to the right of +row, +column.
    """
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    return np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])


def lathe(
    profile: np.ndarray, sides: int = 48, *, repeat_u: float = 1.0, v_per_m: float = 0.0, crease_deg: float = 35.0
) -> Mesh:
    """Build a solid of revolution about z; `profile` (n, 2) of (radius, height) runs upwards on the outside.

    u runs around (`repeat_u` textures), v down the profile (upright images; 1 texture, or `v_per_m` textures per metre).
    """
    line = np.asarray(profile, np.float32)
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    v = -length * v_per_m if v_per_m else 1 - length / length[-1]
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    ring = np.stack([np.cos(angle), np.sin(angle)], -1)
    ring[-1] = ring[0]
    xy = line[:, None, :1] * ring[None]
    points = np.concatenate([xy, np.broadcast_to(line[:, None, 1:], (*xy.shape[:2], 1))], -1)
    uv = np.stack(np.broadcast_arrays(angle[None] / (2 * np.pi) * repeat_u, v[:, None]), -1)
    return mesh(points.reshape(-1, 3), grid_faces(*xy.shape[:2]), uv.reshape(-1, 2), crease_deg=crease_deg)


def tube(
    path: np.ndarray,
    radius: np.ndarray | float,
    sides: int = 14,
    *,
    flat: float = 1.0,
    repeat: tuple[float, float] = (1.0, 1.0),
    up: tuple[float, float, float] = (0.0, 0.0, 1.0),
) -> Mesh:
    """Sweep an ellipse along `path` (n, 3), closed; `radius` (n,) across, times `flat` along the local up."""
    line = np.asarray(path, np.float64)
    r = np.broadcast_to(np.asarray(radius, np.float64), (len(line),))
    along = np.gradient(line, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, up)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    lift = np.cross(across, along)
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    ring = across[:, None] * np.cos(angle)[None, :, None] + flat * lift[:, None] * np.sin(angle)[None, :, None]
    ring[:, -1] = ring[:, 0]
    points = line[:, None] + r[:, None, None] * ring
    points = np.concatenate([np.repeat(line[:1, None], sides + 1, 1), points, np.repeat(line[-1:, None], sides + 1, 1)])
    length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points.mean(1), axis=0), axis=1))])
    uv = np.stack(np.broadcast_arrays(angle[None] / (2 * np.pi) * repeat[0], length[:, None] / length[-1] * repeat[1]), -1)
    return mesh(points.reshape(-1, 3), grid_faces(*points.shape[:2])[:, ::-1], uv.reshape(-1, 2), crease_deg=50.0)


def box(size: tuple[float, float, float], bevel: float = 0.002, *, uv_per_m: float = 0.0) -> Mesh:
    """Build a box on z = 0 with edges cut by `bevel`.

    Each side shows one whole texture, or `uv_per_m` textures per metre.
    """
    half = np.asarray(size, np.float64) / 2
    points: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    uv: list[np.ndarray] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            corner, coords = _side(half, bevel, axis, sign)
            faces.append(np.array([[0, 1, 2], [0, 2, 3]]) + 4 * len(points))
            points.append(corner)
            uv.append(coords)
    quads = np.concatenate(points)
    joined = np.concatenate([*faces, _bevels(quads, half, bevel)]) if bevel else np.concatenate(faces)
    shifted = quads + np.array([0, 0, half[2]])
    scale = uv_per_m if uv_per_m else 0.0
    coords = _metric_uv(quads, scale) if scale else np.concatenate(uv)
    return mesh(shifted, joined, coords, crease_deg=20.0)


def _side(half: np.ndarray, bevel: float, axis: int, sign: float) -> tuple[np.ndarray, np.ndarray]:
    """Return four corners of one side, counter-clockwise seen from outside; uv is upright on vertical sides."""
    right, up = {0: (1, 2), 1: (0, 2), 2: (0, 1)}[axis]
    flip = sign if axis != 1 else -sign
    unit = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], np.float64)
    corner = np.zeros((4, 3))
    corner[:, axis] = sign * half[axis]
    corner[:, right] = unit[:, 0] * flip * (half[right] - bevel)
    corner[:, up] = unit[:, 1] * (half[up] - bevel)
    return corner, (unit * [1, -1] + 1) / 2


def _metric_uv(quads: np.ndarray, per_m: float) -> np.ndarray:
    out = np.zeros((24, 2))
    for side in range(6):
        right, up = {0: (1, 2), 1: (0, 2), 2: (0, 1)}[side // 2]
        out[4 * side : 4 * side + 4] = quads[4 * side : 4 * side + 4][:, [right, up]] * per_m + side * 0.37
    return out


def _bevels(quads: np.ndarray, half: np.ndarray, bevel: float) -> np.ndarray:
    """Close the gaps between the shrunk sides with the other faces of their convex hull."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(quads)
    inside = quads.mean(axis=0)
    keep = [f for f, plane in zip(hull.simplices, hull.equations, strict=True) if np.abs(plane[:3]).max() < 0.999]
    turned = []
    for face in keep:
        a, b, c = quads[face]
        outward = np.dot(np.cross(b - a, c - a), a - inside) > 0
        turned.append(face if outward else face[::-1])
    return np.asarray(turned)


def extrude(outline: np.ndarray, height: float, *, uv_per_m: float = 0.0) -> Mesh:
    """Extrude a star-shaped flat outline (n, 2), counter-clockwise, upwards from z = 0 by `height`."""
    line = np.asarray(outline, np.float64)
    count = len(line)
    centre = line.mean(axis=0)
    low, high = line.min(axis=0), line.max(axis=0)
    rings = np.concatenate([np.c_[line, np.zeros(count)], np.c_[line, np.full(count, height)]])
    caps = np.array([[*centre, 0.0], [*centre, height]])
    index = np.arange(count)
    after = (index + 1) % count
    sides = np.concatenate([np.c_[index, after, after + count], np.c_[index, after + count, index + count]])
    bottom, top = (
        np.c_[after, index, np.full(count, 2 * count)],
        np.c_[index + count, after + count, np.full(count, 2 * count + 1)],
    )
    points = np.concatenate([rings, caps])
    flat = points[:, :2] + points[:, 2:] * 0.7
    uv = flat * uv_per_m if uv_per_m else (flat - low) / (high - low).max()
    return mesh(points, np.concatenate([sides, bottom, top]), uv, crease_deg=30.0)


def patch(origin: np.ndarray, right: np.ndarray, up: np.ndarray, repeat: tuple[float, float] = (1.0, 1.0)) -> Mesh:
    """Build a rectangle from `origin` along `right` and `up` (metres); its front faces right x up."""
    points = np.array([origin, np.add(origin, right), np.add(np.add(origin, right), up), np.add(origin, up)])
    uv = np.array([[0, repeat[1]], [repeat[0], repeat[1]], [repeat[0], 0], [0, 0]])
    return mesh(points, np.array([[0, 1, 2], [0, 2, 3]]), uv)
