"""Regions merged two by two, the most alike first, until one is left: every region that ever was may be a part.

What lived long before it was merged stands out: its `persistence` is by how much the merge that ended it cost more than the one
that made it, over the cost of the last merge of all.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np

from afford.surface.segments.borders import Borders
from afford.surface.segments.features import FaceFeatures

COLOUR, THICKNESS = 0.012, 0.35
"""how much regions differ in the mean, for a unit of CIE Lab and for a factor e of thickness, beside the border between them"""
SMALL = 0.25
"""exponent: small regions merge first, at a cost that falls with this power of their share of the area"""


@dataclass(frozen=True, eq=False)
class RegionTree:
    """Node n < r is a region, others are merges. `leaf` (f,) int32 region of each face; `children` (m - r, 2) int32 of each merge;
    `persistence` (m,) float32 0..1; `share` (m,) of the area.
    """

    leaf: np.ndarray
    children: np.ndarray
    persistence: np.ndarray
    share: np.ndarray

    def members(self) -> np.ndarray:
        """(m, r) bool: the regions in each node."""
        regions = len(self.persistence) - len(self.children)
        out = np.zeros((len(self.persistence), regions), bool)
        out[np.arange(regions), np.arange(regions)] = True
        for n, (a, b) in enumerate(self.children, regions):
            out[n] = out[a] | out[b]
        return out


def merge_regions(leaf: np.ndarray, borders: Borders, features: FaceFeatures) -> RegionTree:
    """The tree above the regions (f,); pieces that touch nowhere are merged last."""
    regions = _RegionMerger(leaf, borders, features)
    while regions.queue:
        regions.step()
    return regions.tree(leaf)


class _RegionMerger:
    """What is known of the regions while they merge: sums that add up, borders, and a queue of possible merges."""

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
        """Merge the pair that costs least, unless one of them is gone."""
        cost, i, j = heapq.heappop(self.queue)
        if i not in self.alive or j not in self.alive:
            return
        new = self._merge(i, j, max(cost, self.born[i], self.born[j]))
        for other in self.touch[new]:
            heapq.heappush(self.queue, (self._cost(new, other), other, new))

    def tree(self, leaf: np.ndarray) -> RegionTree:
        """What came of it. Pieces that are left over are joined at the cost of the most expensive merge."""
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
