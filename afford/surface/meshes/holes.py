"""Small holes closed by fans around their middle. A new face has the colour and the part of the face beside its edge."""

from __future__ import annotations

import numpy as np

from afford.surface.meshes.net import EditMesh, directed_edges, shared_edges


def fill_holes(net: EditMesh, max_edges: int, max_share: float) -> tuple[EditMesh, int, int]:
    """The net, the holes filled and those left open: more edges than `max_edges`, more than `max_share` of the surface, or
    touching themselves.
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
    """Closed rounds of directed edges (as indices), and how many edges run through a vertex where rims meet."""
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
    """Area of a fan, m^2; `ends` (n, 2, 3)."""
    return float(np.linalg.norm(np.cross(ends[:, 1] - middle, ends[:, 0] - middle), axis=1).sum() / 2)
