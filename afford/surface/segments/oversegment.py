"""Faces joined into small regions that cross no strong border (Felzenszwalb and Huttenlocher 2004, on the graph of faces)."""

from __future__ import annotations

import numba
import numpy as np

from afford.surface.segments.borders import Borders


def oversegment(borders: Borders, area: np.ndarray, scale: float, least: float) -> np.ndarray:
    """(f,) int32 label 0..r-1 of each face. `scale`: larger gives larger regions; `least`: regions of less than this share of the
    area join the neighbour behind their weakest border.
    """
    order = np.argsort(borders.strength, kind="stable")
    share = area / max(float(area.sum()), 1e-30)
    root = _join(borders.pair[order], borders.strength[order], share, scale, least)
    return np.unique(root, return_inverse=True)[1].reshape(-1).astype(np.int32)


@numba.njit(cache=True)
def _root(parent, node):  # type: ignore[no-untyped-def]  # numba infers
    while parent[node] != node:
        parent[node] = parent[parent[node]]
        node = parent[node]
    return node


@numba.njit(cache=True)
def _join(pair, strength, share, scale, least):  # type: ignore[no-untyped-def]
    """Root of each face; edges come weakest first."""
    parent, size, inside = np.arange(len(share)), share.copy(), np.zeros(len(share))
    for sweep in range(2):
        for k in range(len(pair)):
            a, b = _root(parent, pair[k, 0]), _root(parent, pair[k, 1])
            if a == b:
                continue
            free = min(inside[a] + scale / max(size[a], 1e-12), inside[b] + scale / max(size[b], 1e-12))
            if strength[k] <= free if sweep == 0 else min(size[a], size[b]) < least:
                parent[b] = a
                size[a] += size[b]
                inside[a] = max(inside[a], inside[b], strength[k])
    return np.array([_root(parent, n) for n in range(len(parent))])
