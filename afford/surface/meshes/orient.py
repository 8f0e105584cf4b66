"""Consistent, outward orientation of faces.

Consistency is a two-colouring: every face is a node twice, as it is and flipped, and consistent neighbours are connected. Outward
is the sign of the volume with holes closed by fans. A body inside another one is flipped with it, so that a cavity stays a cavity.
"""

from __future__ import annotations

import numpy as np

from afford.surface.meshes.net import EditMesh, connected_labels, directed_edges, shared_edges

FLAT = 1e-6
"""bodies whose volume is below this share of area^1.5 have no inside"""


def faces_to_flip(net: EditMesh) -> np.ndarray:
    """Find the faces (f,) bool to flip."""
    count = len(net.faces)
    pairs, rim = shared_edges(net.faces)
    edges, faces = directed_edges(net.faces), pairs // 3
    agree = edges[pairs[:, 0], 0] == edges[pairs[:, 1], 1]
    body = connected_labels(count, faces)
    a, b, apart = faces[:, 0], faces[:, 1], count * ~agree
    double = connected_labels(2 * count, np.concatenate([np.stack([a, b + apart], 1), np.stack([a + count, b + count - apart], 1)]))
    root = np.unique(body, return_index=True)[1]
    flip = double[:count] != double[root][body]
    minority = np.bincount(body, flip) * 2 > np.bincount(body)
    flip ^= minority[body]
    outward = net.turn(flip)
    return flip ^ _inverted(outward, body, rim)[body]


def count_twisted(faces: np.ndarray) -> int:
    """Count neighbours that run along their edge in the same direction, as in a Moebius band; flipping cannot fix them."""
    pairs, _ = shared_edges(faces)
    edges = directed_edges(faces)
    return int((edges[pairs[:, 0], 0] == edges[pairs[:, 1], 0]).sum())


def _inverted(net: EditMesh, body: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """Find bodies (bodies,) bool that face inwards, or are inside one that does."""
    volume = _volumes(net, body, rim)
    size = np.sqrt(np.bincount(body, net.areas))
    inverted = volume < -FLAT * size**3
    outer = _containers(net, body)
    return np.where(outer >= 0, inverted[np.maximum(outer, 0)], inverted)


def _volumes(net: EditMesh, body: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """Compute the signed volume (n,) of each body in m^3, holes closed by fans."""
    number = int(body.max()) + 1
    tri = net.vertices[net.faces]
    centres: np.ndarray = np.stack([np.bincount(body, tri[..., k].mean(axis=1), number) for k in range(3)], axis=1)
    centres = centres / np.bincount(body, minlength=number)[:, None]
    out = _determinants(tri - centres[body][:, None], body, number)
    return out + _fans(net, body, rim, centres, number) if len(rim) else out


def _fans(net: EditMesh, body: np.ndarray, rim: np.ndarray, centres: np.ndarray, number: int) -> np.ndarray:
    """Compute the volume (n,) that closes the holes; `rim` (m,) are directed edges of one face."""
    edges = np.stack([net.faces.reshape(-1)[rim], np.roll(net.faces, -1, axis=1).reshape(-1)[rim]], axis=1)
    owner = body[rim // 3]
    names, index = np.unique(edges, return_inverse=True)
    hole = connected_labels(len(names), index.reshape(-1, 2))[index.reshape(-1, 2)[:, 0]]
    middle: np.ndarray = np.stack([np.bincount(hole, net.vertices[edges].mean(axis=1)[:, k]) for k in range(3)], axis=1)
    middle = middle / np.maximum(np.bincount(hole), 1)[:, None]
    fan = np.stack([net.vertices[edges[:, 1]], net.vertices[edges[:, 0]], middle[hole]], axis=1)
    return _determinants(fan - centres[owner][:, None], owner, number)


def _determinants(tri: np.ndarray, body: np.ndarray, number: int) -> np.ndarray:
    return np.bincount(body, (tri[:, 0] * np.cross(tri[:, 1], tri[:, 2])).sum(axis=1) / 6, number)


def _containers(net: EditMesh, body: np.ndarray) -> np.ndarray:
    """Find the outermost body (n,) around each body, -1 without one."""
    number = int(body.max()) + 1
    tri = net.vertices[net.faces]
    order = np.argsort(body, kind="stable")
    starts = np.searchsorted(body[order], np.arange(number))
    low = np.minimum.reduceat(tri.min(axis=1)[order], starts)
    high = np.maximum.reduceat(tri.max(axis=1)[order], starts)
    point = net.vertices[net.faces[order[starts], 0]]
    out = np.full(number, -1)
    largest = np.argsort(-np.prod(high - low, axis=1), kind="stable")
    for outer in largest:
        boxed = (low[outer] <= low).all(axis=1) & (high <= high[outer]).all(axis=1) & (out < 0)
        boxed[outer] = False
        if out[outer] < 0 and boxed.any():
            faces = net.faces[body == outer]
            for inner in np.flatnonzero(boxed):
                if abs(winding_number(point[inner], net.vertices, faces)) > 0.5:
                    out[inner] = outer
    return out


def winding_number(point: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> float:
    """Compute the generalised winding number at a point: 1 inside a closed surface, 0 outside."""
    a, b, c = (vertices[faces[:, k]] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
    below = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float(np.arctan2((a * np.cross(b, c)).sum(1), below).sum() / (2 * np.pi))

