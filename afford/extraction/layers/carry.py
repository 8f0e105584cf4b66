"""While hardly anything of a held object shows, it moves as the hand that holds it."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from afford.extraction.layers.follow import MIN_PIXELS, Path, carried
from schemas.masks import Tracks
from schemas.video import SIDES

GLIMPSE = 0.25
"""less than this share of the largest visible areas (their 0.9 quantile) is too little to place an object by"""
CARRIED_FIT = 0.6
"""fit of a carried pose: just enough to complete the object with it"""


def holding(tracks: Tracks, index: int) -> np.ndarray:
    """(t, h, w) bool: visible pixels of the hands that touch object `index` in each frame."""
    out = np.zeros(tracks.masks.shape[1:], bool)
    for entity, mask in zip(tracks.entities, tracks.masks, strict=True):
        if entity.role == "hand":
            out |= mask & (tracks.contact[SIDES.index(entity.side)] == index)[:, None, None]
    return out


def carry(path: Path, grey: np.ndarray, visible: np.ndarray, hand: np.ndarray) -> Path:
    """The path with new poses for frames that only glimpse the object, held and between two that show it.

    grey: (t, h, w) uint8. visible, hand: (t, h, w) bool, the object and what holds it. The pose of the last frame before is
    carried forwards by the motion of both, that of the first after backwards, and the two are blended by their distance.
    """
    area = np.count_nonzero(visible, axis=(1, 2))
    if not area.any():
        return path
    shown = np.flatnonzero((path.fit > 0) & (area >= max(MIN_PIXELS, GLIMPSE * np.quantile(area[area > 0], 0.9))))
    held = np.asarray(hand.any(axis=(1, 2)))
    both = hand | visible
    poses, fit = path.poses.copy(), path.fit.copy()
    for start, stop in pairwise(shown.tolist()):
        if not held[start + 1 : stop].any():
            continue
        forwards = _chain(path.poses[start], range(start, stop), grey, both)
        backwards = _chain(path.poses[stop], range(stop, start, -1), grey, both)[::-1]
        for step in np.flatnonzero(held[start + 1 : stop]).tolist():
            share = (step + 1) / (stop - start)
            poses[start + 1 + step] = (1 - share) * forwards[step] + share * backwards[step]
            fit[start + 1 + step] = CARRIED_FIT
    return replace(path, poses=poses, fit=fit)


def _chain(pose: np.ndarray, order: range, grey: np.ndarray, mask: np.ndarray) -> list[np.ndarray]:
    """Poses in the frames of `order` after the first, where the pose is given."""
    out = []
    for before, after in pairwise(order):
        pose = carried(pose, grey[before], grey[after], mask[before], mask[after])
        out.append(pose)
    return out
