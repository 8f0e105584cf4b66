"""Faces that no view voted on take the value of their neighbours: the harmonic function between those that are known."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve
from scipy.spatial import cKDTree

from afford.surface.segments.borders import shared_edges


def harmonic_fill(vertices: np.ndarray, faces: np.ndarray, value: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(f,) float32: `value` where `known` (f,) bool, the mean of the neighbours elsewhere; pieces in which nothing is known take
    the value of the nearest known face. All zeros when nothing is known at all.
    """
    if known.all() or not known.any():
        return np.where(known, value, 0).astype(np.float32)
    graph = face_adjacency(vertices, faces)
    piece = connected_components(graph, directed=False)[1]
    reached = np.isin(piece, np.unique(piece[known]))
    out = np.where(known, value, 0.0).astype(np.float64)
    free = np.flatnonzero(reached & ~known)
    if len(free):
        rows = graph[free]
        degree = rows.sum(1)
        system = coo_array((degree, (np.arange(len(free)), np.arange(len(free)))), shape=(len(free),) * 2).tocsr() - rows[:, free]
        out[free] = spsolve(system.tocsc(), rows[:, np.flatnonzero(known)] @ out[known])
    middle = vertices[faces].mean(1)
    lost = np.flatnonzero(~reached)
    out[lost] = out[reached][cKDTree(middle[reached]).query(middle[lost])[1]]
    return out.clip(0, 1).astype(np.float32)


def face_adjacency(vertices: np.ndarray, faces: np.ndarray):  # type: ignore[no-untyped-def]  # scipy has no types
    """(f, f) sparse symmetric: faces that share an edge, weighted by its length over the mean one."""
    (a, b), length = (found.T for found in shared_edges(vertices, faces))
    weight = np.maximum(length / max(float(length.mean()) if len(length) else 1.0, 1e-30), 1e-6)
    both = coo_array((np.tile(weight, 2), (np.concatenate([a, b]), np.concatenate([b, a]))), shape=(len(faces),) * 2)
    return both.tocsr()
