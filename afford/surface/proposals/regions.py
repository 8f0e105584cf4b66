"""Embedded proposer: a hierarchy of surface regions, cut at concave creases and changes of colour or thickness.

Faces are joined into small regions that cross no strong border (Felzenszwalb and Huttenlocher 2004, on the graph of faces). Regions
are merged in pairs, the most similar first, until one is left; every region of this tree may be a part. The persistence of a region
is the cost of the merge that ended it minus the cost of the merge that created it, relative to the last merge.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numba
import numpy as np

from afford.surface.face_features import Borders, BorderWeights, FaceFeatures
from afford.surface.proposals import Regions
from afford.surface.proposals.nms import collect_candidates, nms
from schemas.mesh import ObjectMesh, ObjectViews
from schemas.surface import PartCandidates

FINEST = 0.0003
"""scale of the smallest regions (see oversegment)"""


def propose(mesh: ObjectMesh, views: ObjectViews, params: Regions) -> PartCandidates:
    """Propose the regions of the tree, as masks in every view (`Propose`)."""
    tree = region_tree(mesh, params.least_share)
    chosen = np.flatnonzero((tree.share >= params.least_share) & (tree.share <= params.most_share))
    nodes, quality = tree.members()[chosen], tree.persistence[chosen]
    found: list[tuple[int, np.ndarray, float]] = []
    for view, face in enumerate(views.face):
        region = np.append(tree.leaf, len(nodes.T))[face]
        size = np.bincount(region.reshape(-1), minlength=len(nodes.T) + 1)[:-1]
        shown = np.flatnonzero((nodes @ size >= params.least_px) & (nodes @ size <= params.most_share * size.sum()))
        masks = np.pad(nodes[shown], ((0, 0), (0, 1)))[:, region]
        found += [(view, masks[k], float(quality[shown[k]])) for k in nms(masks, quality[shown], params.nms_iou, params.most)]
    return collect_candidates(mesh.name, found, views.face.shape[1:])


def region_tree(mesh: ObjectMesh, least: float) -> RegionTree:
    """Build the region tree of a surface."""
    features = FaceFeatures.of(mesh)
    borders = Borders.of(mesh.vertices, mesh.faces, features, BorderWeights())
    return merge_regions(oversegment(borders, features.area, FINEST, least / 2), borders, features)


COLOUR, THICKNESS = 0.012, 0.35
"""weights of the difference of two regions: a unit of CIE Lab, a factor e of thickness; the border adds its own cost"""
SMALL = 0.25
"""exponent of the share of the area in the cost of a merge, so that small regions merge first"""


@dataclass(frozen=True, eq=False)
class RegionTree:
    """Region hierarchy; nodes n < r are initial regions, the others merges.

    `leaf` (f,) int32 is the region of each face, `children` (m - r, 2) int32 the parts of each merge, `persistence` (m,) float32
    0..1, and `share` (m,) the share of the area.
    """

    leaf: np.ndarray
    children: np.ndarray
    persistence: np.ndarray
    share: np.ndarray

    def members(self) -> np.ndarray:
        """Return the initial regions in each node: (m, r) bool."""
        regions = len(self.persistence) - len(self.children)
        out = np.zeros((len(self.persistence), regions), bool)
        out[np.arange(regions), np.arange(regions)] = True
        for n, (a, b) in enumerate(self.children, regions):
            out[n] = out[a] | out[b]
        return out


def merge_regions(leaf: np.ndarray, borders: Borders, features: FaceFeatures) -> RegionTree:
    """Merge initial regions (f,) to a tree; pieces without a common border are merged last."""
    regions = _RegionMerger(leaf, borders, features)
    while regions.queue:
        regions.step()
    return regions.tree(leaf)


class _RegionMerger:
    """State of the merging: sums of features, borders, and a priority queue of merges."""

    def __init__(self, leaf: np.ndarray, borders: Borders, features: FaceFeatures) -> None:
        count = int(leaf.max()) + 1
        self.area = list(np.bincount(leaf, features.area, count))
        traits = np.column_stack([features.colour * COLOUR, np.log(features.thickness) * THICKNESS])
        self.sums = list(np.stack([np.bincount(leaf, features.area * t, count) for t in traits.T], -1))
        self.total, self.count = float(features.area.sum()), count
        self.touch: list[dict[int, tuple[float, float]]] = [{} for _ in range(count)]
        a, b = leaf[borders.pair].T
        for i, j, long, strong in zip(a, b, borders.length, borders.length * borders.strength, strict=True):
            if i != j:
                self._meet(int(i), int(j), float(long), float(strong))
        self.alive, self.born = set(range(count)), [0.0] * count
        self.died, self.children = [0.0] * count, list[tuple[int, int]]()
        self.queue = [(self._cost(i, j), i, j) for i in range(count) for j in self.touch[i] if i < j]
        heapq.heapify(self.queue)

    def step(self) -> None:
        """Execute the cheapest merge unless one of its regions no longer exists."""
        cost, i, j = heapq.heappop(self.queue)
        if i not in self.alive or j not in self.alive:
            return
        new = self._merge(i, j, max(cost, self.born[i], self.born[j]))
        for other in self.touch[new]:
            heapq.heappush(self.queue, (self._cost(new, other), other, new))

    def tree(self, leaf: np.ndarray) -> RegionTree:
        """Build the tree; remaining pieces are joined at the cost of the most expensive merge."""
        rest = sorted(self.alive)
        last = max([*self.born, 1e-9])
        while len(rest) > 1:
            rest = [*rest[2:], self._merge(rest[0], rest[1], last)]
        self.died[rest[0]] = self.born[rest[0]]
        persistence = (np.array(self.died) - np.array(self.born)) / last
        children = np.array(self.children, np.int32).reshape(-1, 2)
        return RegionTree(leaf, children, persistence.clip(0, 1).astype(np.float32), np.array(self.area) / self.total)

    def _merge(self, i: int, j: int, cost: float) -> int:
        new = len(self.area)
        self.area.append(self.area[i] + self.area[j])
        self.sums.append(self.sums[i] + self.sums[j])
        self.touch.append({})
        self.born.append(cost)
        self.died.append(0.0)
        self.children.append((i, j))
        for old in (i, j):
            self.died[old] = cost
            self.alive.discard(old)
            for other, (long, strong) in self.touch[old].items():
                if other in self.alive:
                    self._meet(new, other, long, strong)
        self.alive.add(new)
        return new

    def _meet(self, i: int, j: int, long: float, strong: float) -> None:
        had = self.touch[i].get(j, (0.0, 0.0))
        self.touch[i][j] = self.touch[j][i] = (had[0] + long, had[1] + strong)

    def _cost(self, i: int, j: int) -> float:
        long, strong = self.touch[i][j]
        apart = float(np.linalg.norm(self.sums[i] / self.area[i] - self.sums[j] / self.area[j]))
        small = min(self.area[i], self.area[j]) / self.total
        return (strong / max(long, 1e-12) + apart) * small**SMALL


def oversegment(borders: Borders, area: np.ndarray, scale: float, least: float) -> np.ndarray:
    """Label faces (f,) int32 0..r-1 by small regions.

    A larger `scale` gives larger regions. Regions of less than the share `least` of the area join the neighbour across their
    weakest border.
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
    """Find the root of each face; edges are sorted by strength."""
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
