"""How each hand and its object move on in the image after a sample: centroids of their masks at equal steps of time."""

from __future__ import annotations

from functools import cache

import numpy as np

from schemas.masks import CompleteObjects, Tracks

NS_PER_S = 1_000_000_000


def centroid(mask: np.ndarray) -> np.ndarray:
    """(h, w) bool -> (2,) float32 x, y of the mean pixel; NaN for an empty mask."""
    columns, rows = mask.sum(0), mask.sum(1)
    count = columns.sum()
    if not count:
        return np.full(2, np.nan, np.float32)
    return np.array([columns @ np.arange(columns.size) / count, rows @ np.arange(rows.size) / count], np.float32)


class Paths:
    """Paths of one clip's hands (visible masks) and objects (complete masks); every centroid is computed once.

    A step takes the frame nearest in time, at most half a step away; without one (clip at its end, sparse frames, entity out
    of sight) the point is NaN. Points are in the image of their own frame: the camera's motion is part of the path.
    """

    def __init__(self, tracks: Tracks, complete: CompleteObjects, time_ns: np.ndarray, motion_s: float, steps: int) -> None:
        if steps < 2 or motion_s <= 0:
            raise ValueError(f"motion needs at least 2 steps over more than 0 s, got {steps} steps over {motion_s} s")
        self.time_ns = time_ns
        self.steps_ns = np.rint(np.linspace(0, motion_s * NS_PER_S, steps)).astype(np.int64)
        masks = {entity.entity_id: tracks.masks[n] for n, entity in enumerate(tracks.entities)}
        masks |= {entity.entity_id: complete.masks[n] for n, entity in enumerate(complete.entities)}
        self.known = frozenset(masks)
        self.centroid = cache(lambda entity_id, t: centroid(masks[entity_id][t]))

    def rows_after(self, t: int) -> list[int]:
        """Row of the frame nearest to each step after row t, -1 where none is near enough."""
        wanted = self.time_ns[t] + self.steps_ns
        right = np.searchsorted(self.time_ns, wanted).clip(0, self.time_ns.size - 1)
        left = (right - 1).clip(0)
        nearest = np.where(wanted - self.time_ns[left] < self.time_ns[right] - wanted, left, right)
        far = np.abs(self.time_ns[nearest] - wanted) > self.steps_ns[1] // 2
        return np.where(far, -1, nearest).tolist()

    def after(self, t: int, object_ids: list[str]) -> np.ndarray:
        """(4, steps, 2) float32 px: left hand, right hand, then the given left and right objects ('' for none)."""
        rows = self.rows_after(t)
        path = np.full((4, len(rows), 2), np.nan, np.float32)
        for n, entity_id in enumerate(["left hand", "right hand", *object_ids]):
            if entity_id in self.known:
                for step, row in enumerate(rows):
                    if row >= 0:
                        path[n, step] = self.centroid(entity_id, row)
        return path
