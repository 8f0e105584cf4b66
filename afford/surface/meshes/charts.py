"""UV unwrapping: axis-aligned charts, packed into one texture.

A chart is a connected patch projected along an axis of the object, so that a face keeps at least about half its area. Faces hidden
behind other faces of their chart become a chart of their own. 20,000 faces take a fraction of a second, and the result is the same
on every machine; xatlas wastes less of the texture but takes several seconds.
"""

from __future__ import annotations

import numba
import numpy as np

from afford.surface.meshes.net import MeshError, area_normals, connected_labels, shared_edges

GAP_PX = 4
"""texels between charts"""
SMOOTHING = 6
STEEPEST = 0.25
"""smallest cosine between a face normal and the projection axis of its chart"""
LAYERS = 8
LONGEST = 0.6
"""largest length of a chart along the object, in square roots of the object's area"""


def unwrap(vertices: np.ndarray, faces: np.ndarray, side: int) -> np.ndarray:
    """Compute texture coordinates (f, 3, 2) float32 0..1 for a texture of `side` texels.

    Vertices (v, 3), faces (f, 3). Raises MeshError when the charts do not fit.
    """
    local, normals = _local(np.asarray(vertices, np.float64), faces)
    pairs = shared_edges(faces)[0] // 3
    way = _ways(normals, pairs)
    way = way + 6 * _slices(local)
    flat, depth = _seen(local, way % 6)
    layer = np.zeros(len(faces), np.int64)
    for _ in range(LAYERS):
        same = (way[pairs[:, 0]] == way[pairs[:, 1]]) & (layer[pairs[:, 0]] == layer[pairs[:, 1]])
        chart = connected_labels(len(faces), pairs[same])
        place, scale = _layout(flat, chart, side)
        hidden = _hidden(place, depth * scale, side)
        if not hidden.any():
            break
        layer[hidden] += 1
    return (place * [1, -1] / side + [0, 1]).astype(np.float32)


def _local(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Transform corners (f, 3, 3) and unit normals (f, 3) to the principal axes of the object."""
    weight = np.linalg.norm(area_normals(vertices, faces), axis=1)
    spread = np.cov(vertices[faces].mean(axis=1).T, aweights=weight)
    axes = np.linalg.eigh(spread)[1]
    turned = vertices @ (axes * np.sign(np.linalg.det(axes)))
    normals = area_normals(turned, faces)
    return turned[faces], normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)


def _ways(normals: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Choose one of six projection axes for each face (f,), smoothed over neighbours."""
    six = np.concatenate([np.eye(3), -np.eye(3)])
    both = np.concatenate([pairs, pairs[:, ::-1]])
    smooth = normals.copy()
    for _ in range(SMOOTHING):
        around = np.stack([np.bincount(both[:, 0], smooth[both[:, 1], k], len(normals)) for k in range(3)], axis=1)
        smooth = smooth + around
        smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-30)
    way = (smooth @ six.T).argmax(axis=1)
    steep = (normals * six[way]).sum(axis=1) < STEEPEST
    return np.where(steep, (normals @ six.T).argmax(axis=1), way)


def _slices(local: np.ndarray) -> np.ndarray:
    """Return the slice (f,) of each face across the long axis, which limits the length of charts."""
    area = np.linalg.norm(np.cross(local[:, 1] - local[:, 0], local[:, 2] - local[:, 0]), axis=1).sum() / 2
    along = local[:, :, 2].mean(axis=1)
    return ((along - along.min()) / max(LONGEST * np.sqrt(area), 1e-30)).astype(np.int64)


def _seen(local: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Project corners (f, 3, 2), and return their depth towards the viewer (f, 3)."""
    right, up = np.array([(1, 2), (2, 0), (0, 1), (2, 1), (0, 2), (1, 0)])[way].T
    row, corner = np.arange(len(way))[:, None], np.arange(3)[None]
    flat = np.stack([local[row, corner, right[:, None]], local[row, corner, up[:, None]]], axis=-1)
    return flat, local[row, corner, (way % 3)[:, None]] * np.where(way < 3, 1, -1)[:, None]


def _layout(flat: np.ndarray, chart: np.ndarray, side: int) -> tuple[np.ndarray, float]:
    """Pack charts on shelves at the largest scale that fits: corners in texels (f, 3, 2), texels per metre."""
    count = int(chart.max()) + 1
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, chart, flat.min(axis=1))
    np.maximum.at(high, chart, flat.max(axis=1))
    size = high - low
    order = np.lexsort((np.arange(count), -size[:, 0], -size[:, 1]))
    most, best = (side - GAP_PX) / max(float(size.max()), 1e-30), None
    few = 0.0
    for _ in range(14):
        scale = most if best is None and few == 0.0 else (few + most) / 2
        corners = _shelves(size[order] * scale + GAP_PX, side)
        if corners is None:
            most, few = (scale, few) if few or best is not None else (scale, 1e-9 * scale)
        else:
            few, best = scale, corners
            if scale == most:
                break
    if best is None:
        raise MeshError(f"a surface whose pieces fit into {side} x {side} texels", f"{count} pieces",
                        "drop more dust or raise max_texture_px")
    at = np.zeros((count, 2))
    at[order] = best
    return (flat - low[chart][:, None]) * few + at[chart][:, None] + GAP_PX / 2, few


@numba.njit(cache=True)
def _shelves(size, side):  # type: ignore[no-untyped-def]  # numba infers
    """Pack boxes (n, 2), sorted by height, row by row: corners (n, 2), or None if they do not fit into `side`."""
    out = np.zeros(size.shape)
    x, y, shelf = 0.0, 0.0, 0.0
    for k in range(len(size)):
        if x + size[k, 0] > side:
            x, y, shelf = 0.0, y + shelf, 0.0
        if x + size[k, 0] > side or y + size[k, 1] > side:
            return None
        out[k, 0], out[k, 1] = x, y
        x += size[k, 0]
        shelf = max(shelf, size[k, 1])
    return out


@numba.njit(cache=True)
def _hidden(place, depth, side):  # type: ignore[no-untyped-def]  # numba infers
    """Find faces (f,) bool whose centre is two texels or more behind another face of the texture."""
    near = np.full((side, side), -1e30)
    for f in range(len(place)):
        x, y, z = place[f, :, 0], place[f, :, 1], depth[f]
        area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
        if abs(area) < 1e-12:
            continue
        for row in range(max(0, int(np.floor(y.min()))), min(side, int(np.ceil(y.max())) + 1)):
            for column in range(max(0, int(np.floor(x.min()))), min(side, int(np.ceil(x.max())) + 1)):
                b = ((x[2] - column - 0.5) * (y[0] - row - 0.5) - (x[0] - column - 0.5) * (y[2] - row - 0.5)) / area
                c = ((x[0] - column - 0.5) * (y[1] - row - 0.5) - (x[1] - column - 0.5) * (y[0] - row - 0.5)) / area
                if b >= 0 and c >= 0 and b + c <= 1:
                    near[row, column] = max(near[row, column], (1 - b - c) * z[0] + b * z[1] + c * z[2])
    out = np.zeros(len(place), np.bool_)
    for f in range(len(place)):
        row, column = int(place[f, :, 1].mean()), int(place[f, :, 0].mean())
        steep = depth[f].max() - depth[f].min()
        out[f] = near[min(row, side - 1), min(column, side - 1)] > depth[f].mean() + 2.0 + steep
    return out
