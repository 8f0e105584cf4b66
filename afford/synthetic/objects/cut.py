"""A triangle mesh cut along the zero line of a function, so that every face lies on one side of it."""

from __future__ import annotations

import numpy as np

NEAR = 0.12
"""A cut keeps this share of an edge away from its ends, so that no sliver arises."""


def cut(vertices: np.ndarray, faces: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Vertices (v, 3), faces (f, 3) and values (v,) -> more vertices, int32 faces, the face that each is a piece of, and its
    side: 1 where the value is positive or zero, else 0. A closed surface stays closed.
    """
    side = np.asarray(value) >= 0
    lone = _lone_corner(side[faces])
    crossed = np.flatnonzero(lone >= 0)
    if not len(crossed):
        return vertices, np.asarray(faces, np.int32), np.arange(len(faces)), side[faces[:, 0]].astype(np.int64)
    turned = np.take_along_axis(faces[crossed], (lone[crossed, None] + np.arange(3)) % 3, axis=1)
    a, b, c = turned.T
    points, (ab, ac) = _midpoints(vertices, value, np.stack([np.stack([a, b], -1), np.stack([a, c], -1)]))
    pieces = np.concatenate([np.stack(corner, -1) for corner in ((a, ab, ac), (ab, b, c), (ab, c, ac))])
    whole = np.flatnonzero(lone < 0)
    out_side = np.concatenate([side[faces[whole, 0]], side[a], side[b], side[b]]).astype(np.int64)
    order = np.argsort(source := np.concatenate([whole, crossed, crossed, crossed]), kind="stable")
    return points, np.concatenate([faces[whole], pieces])[order].astype(np.int32), source[order], out_side[order]


def _lone_corner(side: np.ndarray) -> np.ndarray:
    """(f,) corner that is alone on its side, -1 where all three agree."""
    count = side.sum(axis=1)
    alone = np.where((count == 1)[:, None], side, ~side).argmax(axis=1)
    return np.where((count == 1) | (count == 2), alone, -1)


def _midpoints(vertices: np.ndarray, value: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All vertices with one new point for every edge (2, n, 2) that is crossed, and the indices (2, n) of those points."""
    ends, index = np.unique(np.sort(edges.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    start, stop = ends.T
    share = np.clip(value[start] / (value[start] - value[stop]), NEAR, 1 - NEAR)[:, None]
    new = vertices[start] * (1 - share) + vertices[stop] * share
    return np.concatenate([vertices, new]), len(vertices) + index.reshape(edges.shape[:2])
