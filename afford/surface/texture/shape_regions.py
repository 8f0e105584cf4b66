"""Segment a surface into a few regions by shape alone.

Features of a face are thickness (shape diameter, Shapira et al. 2008), position along the main axis, distance from it, and
curvature. They are smoothed over neighbouring faces, less across sharp creases, and clustered by k-means. Similar clusters are
merged, and small patches join the neighbour with the longest border.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array
from scipy.spatial import cKDTree
from trimesh import Trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from afford.surface.meshes.net import area_normals, connected_labels, directed_edges, shared_edges

CONE_DEG, RAYS = 25.0, 6
CREASE_DEG = 35.0
SMOOTHING = 24
"""smoothing passes"""
ALIKE = 0.4
"""distance of features below which clusters are merged"""
PATCH = 0.03
"""share of the surface below which a patch joins a neighbour"""
ROUNDS = 40


def main_axis(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the centroid (3,) of a surface and its principal axes (3, 3), one per row, the longest first."""
    weight = np.linalg.norm(area_normals(vertices, faces), axis=1)
    points = vertices[faces].mean(axis=1)
    middle = np.average(points, axis=0, weights=weight)
    spread = np.cov((points - middle).T, aweights=weight)
    axes = np.linalg.eigh(spread)[1].T[::-1]
    return middle, axes * np.sign(axes[np.arange(3), np.abs(axes).argmax(axis=1)])[:, None]


def thickness(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute the shape diameter (f,): the median length of a cone of inward rays, the diagonal without a hit."""
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    body = Trimesh((vertices - vertices.min(axis=0)) / size, faces, process=False)
    normals = area_normals(np.asarray(body.vertices), faces)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    side = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-30)
    other, start = np.cross(normals, side), body.triangles_center - normals * 1e-4
    caster, found = RayMeshIntersector(body), []
    for turn in 2 * np.pi * np.arange(RAYS) / RAYS:
        lean = np.tan(np.radians(CONE_DEG)) * (np.cos(turn) * side + np.sin(turn) * other)
        ray = lean - normals
        ray /= np.linalg.norm(ray, axis=1, keepdims=True)
        hit = caster.intersects_first(start, ray)
        first = body.triangles[hit][:, 0]
        along = ((first - start) * normals[hit]).sum(1) / np.where(np.abs(d := (ray * normals[hit]).sum(1)) > 1e-9, d, 1e-9)
        found.append(np.where(hit >= 0, np.clip(along, 1e-4, 1.0), 1.0))
    return np.median(found, axis=0) * size


def neighbours(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pairs of faces (n, 2) with a common edge, its length (n,) and their angle (n,) in radians."""
    pairs, _ = shared_edges(faces)
    edge = directed_edges(faces)[pairs[:, 0]]
    length = np.linalg.norm(vertices[edge[:, 0]] - vertices[edge[:, 1]], axis=1)
    normal = area_normals(vertices, faces)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    pairs = pairs // 3
    return pairs, length, np.arccos(np.clip((normal[pairs[:, 0]] * normal[pairs[:, 1]]).sum(axis=1), -1, 1))


def shape_regions(vertices: np.ndarray, faces: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Segment into at most `most` regions.

    Returns the region (f,) of each face and the mean thickness (r,) of each region in metres, thinnest first.
    """
    vertices = np.asarray(vertices, np.float64)
    faces = np.asarray(faces, np.int64)
    area = np.linalg.norm(area_normals(vertices, faces), axis=1) / 2
    pairs, length, angle = neighbours(vertices, faces)
    thick = thickness(vertices, faces)
    mix = _mixer(len(faces), pairs, length * np.exp(-((angle / np.radians(CREASE_DEG)) ** 2)), area)
    features = _features(vertices, faces, area, thick, _bend(pairs, length, angle, area))
    for _ in range(SMOOTHING):
        features = mix @ features
    middles = vertices[faces].mean(axis=1)
    label = _patched(_cluster(_calm(features, area), area, most), pairs, length, area, middles)
    mean = np.bincount(label, thick * area) / np.bincount(label, area)
    order = np.argsort(mean, kind="stable")
    return np.argsort(order, kind="stable")[label], mean[order]


def _bend(pairs: np.ndarray, length: np.ndarray, angle: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Compute the mean curvature (f,) of each face, 1/m."""
    both = np.concatenate([pairs[:, 0], pairs[:, 1]])
    return np.bincount(both, np.tile(length * angle, 2), len(area)) / (4 * np.maximum(area, 1e-12))


def _mixer(count: int, pairs: np.ndarray, weight: np.ndarray, area: np.ndarray) -> csr_array:
    """Build the (f, f) matrix that averages each face with its neighbours."""
    own = np.sqrt(np.maximum(area, 1e-14))
    rows, columns = np.concatenate([pairs, pairs[:, ::-1]]).T
    graph = coo_array((np.tile(weight, 2), (rows, columns)), shape=(count, count)).tocsr() + diags_array(own)
    return csr_array(diags_array(1 / graph.sum(axis=1)) @ graph)


def _features(vertices: np.ndarray, faces: np.ndarray, area: np.ndarray, thick: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """Compute (f, 4) thickness, position along the axis, distance from it, curvature, in comparable units."""
    middle, axes = main_axis(vertices, faces)
    local = (vertices[faces].mean(axis=1) - middle) @ axes.T
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    away = np.linalg.norm(local[:, 1:], axis=1)
    thin, curved = np.log2(thick / size + 0.01), 0.25 * np.log2(bend * size + 1)
    return np.stack([thin, local[:, 0] / size, 1.6 * away / size, curved], axis=1)


def _calm(features: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Clip features to their 2 % and 98 % quantiles by area."""
    out = features.copy()
    for column in out.T:
        order = np.argsort(column, kind="stable")
        share = np.cumsum(area[order]) / area.sum()
        low, high = column[order[np.searchsorted(share, (0.02, 0.98)).clip(0, len(order) - 1)]]
        np.clip(column, low, high, out=column)
    return out


def _cluster(features: np.ndarray, area: np.ndarray, most: int) -> np.ndarray:
    """Cluster by area-weighted k-means (f,), initialised with distant features; similar clusters are merged."""
    centres = np.average(features, axis=0, weights=area)[None]
    for _ in range(most + 1):
        centres = np.concatenate([centres, features[_distance(features, centres).min(axis=1).argmax()][None]])
    label = np.zeros(len(features), np.int64)
    for _ in range(ROUNDS):
        label = _distance(features, centres).argmin(axis=1)
        total = np.bincount(label, area, len(centres))
        sums = np.stack([np.bincount(label, area * column, len(centres)) for column in features.T], axis=1)
        centres = np.where(total[:, None] > 0, sums / np.maximum(total, 1e-30)[:, None], centres)
    total = np.bincount(label, area, len(centres))
    names = np.arange(len(centres))
    while len(live := np.flatnonzero(total > 0)) > 1:
        gaps = np.linalg.norm(centres[live][:, None] - centres[live][None], axis=2) + np.eye(len(live)) * 1e9
        i, j = np.unravel_index(gaps.argmin(), gaps.shape)
        a, b = live[min(i, j)], live[max(i, j)]
        if gaps.min() >= ALIKE and len(live) <= most:
            break
        centres[a] = (centres[a] * total[a] + centres[b] * total[b]) / (total[a] + total[b])
        total[a], total[b] = total[a] + total[b], 0.0
        names[names == b] = a
    return names[label]


def _distance(features: np.ndarray, centres: np.ndarray) -> np.ndarray:
    return np.stack([((features - centre) ** 2).sum(axis=1) for centre in centres], axis=1)


def _patched(label: np.ndarray, pairs: np.ndarray, length: np.ndarray, area: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """Relabel small patches by the neighbour with the longest border, loose ones by the nearest face."""
    label = label.copy()
    body = connected_labels(len(label), pairs)
    loose = np.bincount(body, area)[body] < PATCH * area.sum()
    if loose.any() and not loose.all():
        label[loose] = label[~loose][cKDTree(middles[~loose]).query(middles[loose])[1]]
    for _ in range(len(label)):
        same = label[pairs[:, 0]] == label[pairs[:, 1]]
        patch = connected_labels(len(label), pairs[same])
        sizes = np.bincount(patch, area)
        a, b, border = patch[pairs[~same, 0]], patch[pairs[~same, 1]], length[~same]
        small = np.flatnonzero(sizes < PATCH * area.sum())
        small = small[np.isin(small, a) | np.isin(small, b)]
        if not len(small):
            break
        least = small[sizes[small].argmin()]
        touching = np.concatenate([b[a == least], a[b == least]])
        shares = np.bincount(touching, np.concatenate([border[a == least], border[b == least]]))
        label[patch == least] = label[patch == shares.argmax()][0]
    return np.asarray(np.unique(label, return_inverse=True)[1], np.int64).reshape(-1)
