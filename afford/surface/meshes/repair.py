"""Mesh repair: merge vertices, drop empty and repeated faces and dust, orient faces, fill small holes.

Every step is counted. Texture seams survive, because texture coordinates belong to corners and not to vertices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.surface.meshes.net import EditMesh, MeshError, area_normals, bodies, directed_edges, edit_mesh, shared_edges
from afford.surface.meshes.orient import count_twisted, faces_to_flip

SAME_PLACE = 1e-7
"""distance, as a share of the diagonal, below which vertices are merged"""
NO_AREA = 1e-14
"""area, as a share of diagonal^2, below which faces are dropped"""


@dataclass(frozen=True)
class RepairLimits:
    """Limits of the repair."""

    hole_edges: int
    """holes with more edges stay open"""
    hole_share: float
    """holes with more than this share of the surface stay open"""
    dust_share: float
    """bodies with less than this share of the surface are dropped"""


Counts = tuple[tuple[str, int], ...]


def repair(vertices: np.ndarray, faces: np.ndarray, limits: RepairLimits) -> tuple[EditMesh, Counts]:
    """Repair a mesh; also return the count of each step that changed something. MeshError when nothing is left."""
    net, merged = merge_vertices(edit_mesh(vertices, faces))
    net, empty = drop_empty(net)
    net, repeated = drop_repeated(net)
    if not len(net.faces):
        raise MeshError("faces with an area", f"{len(faces)} that are all empty", "export the mesh again")
    net, dust = drop_dust(net, limits.dust_share)
    mask = faces_to_flip(net)
    net = net.turn(mask)
    net, filled, left = fill_holes(net, limits.hole_edges, limits.hole_share)
    done = (("vertices merged", merged), ("empty faces dropped", empty), ("repeated faces dropped", repeated),
            ("faces of dust dropped", dust), ("faces turned", int(mask.sum())), ("holes filled", filled),
            ("holes left open", left), ("edges left twisted", count_twisted(net.faces)))  # fmt: skip
    return net.compact(), tuple((what, count) for what, count in done if count)


def merge_vertices(net: EditMesh) -> tuple[EditMesh, int]:
    """Merge vertices at the same position into the first one, and count the vertices removed."""
    low, size = net.vertices.min(axis=0), np.linalg.norm(np.ptp(net.vertices, axis=0))
    cells = np.round((net.vertices - low) / max(size * SAME_PLACE, 1e-300)).astype(np.int64)
    order = np.lexsort(cells.T[::-1])
    new = np.concatenate([[True], (np.diff(cells[order], axis=0) != 0).any(axis=1)])
    first = np.minimum.reduceat(order, np.flatnonzero(new))
    index = np.zeros(len(order), np.int64)
    index[order] = first[np.cumsum(new) - 1]
    before = len(np.unique(net.faces))
    faces = index[net.faces]
    return EditMesh(net.vertices, faces, net.corner), before - len(np.unique(faces))


def drop_empty(net: EditMesh) -> tuple[EditMesh, int]:
    """Drop faces without area."""
    size = np.linalg.norm(np.ptp(net.vertices[np.unique(net.faces)], axis=0))
    a, b, c = net.faces.T
    full = (a != b) & (b != c) & (c != a) & (np.linalg.norm(area_normals(net.vertices, net.faces), axis=1) > NO_AREA * size**2)
    return net.keep(full), int((~full).sum())


def drop_repeated(net: EditMesh) -> tuple[EditMesh, int]:
    """Drop faces over the same three vertices as an earlier face, in any orientation."""
    _, first = np.unique(np.sort(net.faces, axis=1), axis=0, return_index=True)
    kept = np.zeros(len(net.faces), bool)
    kept[first] = True
    return net.keep(kept), int((~kept).sum())


def drop_dust(net: EditMesh, share: float) -> tuple[EditMesh, int]:
    """Drop bodies whose area is below `share` of the total; the largest one always stays."""
    body = bodies(net.faces)
    areas = np.bincount(body, net.areas)
    kept = (areas >= share * areas.sum()) | (np.arange(len(areas)) == areas.argmax())
    return net.keep(kept[body]), int((~kept[body]).sum())


def fill_holes(net: EditMesh, max_edges: int, max_share: float) -> tuple[EditMesh, int, int]:
    """Fill small holes by fans around their centre; count the holes filled and those left open.

    Holes with more than `max_edges` edges or more than `max_share` of the surface stay open, and so do holes that touch each other.
    A new face takes colour and part of the face at its edge.
    """
    _, rim = shared_edges(net.faces)
    edges = directed_edges(net.faces)[rim]
    loops, tangled = _loops(edges)
    limit = max_share * net.areas.sum()
    small = [loop for loop in loops if len(loop) <= max_edges]
    patches = [(loop, _middle(net, edges[loop])) for loop in small]
    chosen = [(loop, middle) for loop, middle in patches if 0 < _area(net.vertices[edges[loop]], middle) <= limit]
    if not chosen:
        return net, 0, len(loops) + tangled
    middles = np.array([middle for _, middle in chosen])
    which = np.repeat(np.arange(len(chosen)), [len(loop) for loop, _ in chosen])
    at = np.concatenate([loop for loop, _ in chosen])
    new = np.stack([edges[at, 1], edges[at, 0], len(net.vertices) + which], axis=1)
    begin = rim[at]
    end = begin - begin % 3 + (begin + 1) % 3
    corner = net.corner.reshape(-1)[np.stack([end, begin, begin], axis=1)]
    vertices, faces = np.concatenate([net.vertices, middles]), np.concatenate([net.faces, new])
    filled = EditMesh(vertices, faces, np.concatenate([net.corner, corner]))
    return filled, len(chosen), len(loops) + tangled - len(chosen)


def _loops(edges: np.ndarray) -> tuple[list[np.ndarray], int]:
    """Return closed loops of directed edges (as indices), and the number of loops through a shared vertex."""
    starts, counts = np.unique(edges[:, 0], return_counts=True)
    ends, arrivals = np.unique(edges[:, 1], return_counts=True)
    busy = set(starts[counts > 1]) | set(ends[arrivals > 1]) | set(np.setxor1d(starts, ends))
    after = {int(a): k for k, (a, _) in enumerate(edges)}
    seen, loops, tangled = np.zeros(len(edges), bool), [], 0
    for first in range(len(edges)):
        round_, at = [], first
        while not seen[at]:
            seen[at] = True
            round_.append(at)
            at = after.get(int(edges[at, 1]), first)
        if not round_:
            continue
        if busy.isdisjoint(edges[round_].reshape(-1).tolist()):
            loops.append(np.array(round_))
        else:
            tangled += 1
    return loops, tangled


def _middle(net: EditMesh, edges: np.ndarray) -> np.ndarray:
    return net.vertices[edges[:, 0]].mean(axis=0)


def _area(ends: np.ndarray, middle: np.ndarray) -> float:
    """Compute the area of a fan in m^2; `ends` (n, 2, 3)."""
    return float(np.linalg.norm(np.cross(ends[:, 1] - middle, ends[:, 0] - middle), axis=1).sum() / 2)
