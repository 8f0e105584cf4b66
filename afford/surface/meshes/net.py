"""Triangles under repair, with the origin of each corner; edges, components, watertightness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components


@dataclass(frozen=True, eq=False)
class EditMesh:
    """Mesh under repair; attributes of source corners are looked up by `corner`."""

    vertices: np.ndarray
    """(v, 3) float64 metres"""
    faces: np.ndarray
    """(f, 3) int64"""
    corner: np.ndarray
    """(f, 3) int64 corner of the source, 3 * face + place"""

    def keep(self, mask: np.ndarray) -> EditMesh:
        """Keep the faces of `mask` (f,) bool; vertices stay."""
        return EditMesh(self.vertices, self.faces[mask], self.corner[mask])

    def turn(self, mask: np.ndarray) -> EditMesh:
        """Flip the faces of `mask`."""
        swap = mask[:, None]
        faces, corner = (np.where(swap, rows[:, ::-1], rows) for rows in (self.faces, self.corner))
        return EditMesh(self.vertices, faces, corner)

    def compact(self) -> EditMesh:
        """Remove vertices without faces."""
        used, index = np.unique(self.faces, return_inverse=True)
        return EditMesh(self.vertices[used], index.reshape(-1, 3), self.corner)

    @property
    def areas(self) -> np.ndarray:
        """Face areas (f,) in m^2."""
        return np.linalg.norm(area_normals(self.vertices, self.faces), axis=1) / 2


def edit_mesh(vertices: np.ndarray, faces: np.ndarray) -> EditMesh:
    """Start the repair of a mesh."""
    return EditMesh(vertices, faces, np.arange(faces.size).reshape(-1, 3))


def area_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute face normals (f, 3) whose length is twice the area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def directed_edges(faces: np.ndarray) -> np.ndarray:
    """Return the (3 f, 2) edges in the direction of their faces; edge 3 * face + k starts at corner k."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)


def shared_edges(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (n, 2) pairs of directed edges that exactly two faces share, and (m,) edges of one face."""
    edges = np.sort(directed_edges(faces), axis=1)
    key = edges[:, 0] * (int(faces.max(initial=0)) + 1) + edges[:, 1]
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.concatenate([[True], np.diff(key[order]) != 0])) if len(order) else np.zeros(0, np.int64)
    count = np.diff(np.append(first, len(order)))
    two = first[count == 2]
    return np.stack([order[two], order[two + 1]], axis=1), np.sort(order[first[count == 1]])


def connected_labels(count: int, pairs: np.ndarray) -> np.ndarray:
    """Label the connected component of each node: (count,), numbered by first node."""
    graph = coo_array((np.ones(len(pairs), np.int8), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def bodies(faces: np.ndarray) -> np.ndarray:
    """Label the body (f,) of each face, from 0 without gaps; faces with a common vertex belong to one body."""
    label = connected_labels(int(faces.max(initial=-1)) + 1, directed_edges(faces))[faces[:, 0]]
    return np.asarray(np.unique(label, return_inverse=True)[1], np.int64).reshape(-1)


def watertight(faces: np.ndarray) -> bool:
    """Return True if every edge has exactly two faces, which run along it in opposite directions."""
    pairs, open_edges = shared_edges(faces)
    edges = directed_edges(faces)
    return bool(len(faces) and 2 * len(pairs) == len(edges) and not len(open_edges)
                and (edges[pairs[:, 0], 0] == edges[pairs[:, 1], 1]).all())


class MeshError(ValueError):
    """Unusable mesh: what is expected, what was found, and a fix; the file is not known yet."""

    def __init__(self, expected: str, got: str, fix: str) -> None:
        super().__init__(f"expected {expected}, got {got}; {fix}")
        self.expected, self.got, self.fix = expected, got, fix
