"""What moves as a hand does while the background does not: for every look, and over time."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from afford.common.masks import dilate, fill_nearest
from afford.extraction.hands.looks import Looks

NEAR_PX = 6.0
"""px of flow: a hand moves as it does within this distance; its arm may turn another way"""
MOST = 8.0
"""log odds that are remembered at most"""


def moves_along(looks: Looks, k: int, hand: np.ndarray, hands: np.ndarray, far_px: float) -> np.ndarray:
    """(h, w) float32: near 1 for what moves as the nearest part of a hand that moves, near -1 for what rests as the background
    does, else 0; 0 farther than `far_px` from the hand. hands (h, w) bool: all hands of look k.
    """
    flow = _flow(looks, k)
    if flow is None:
        return np.zeros(hand.shape, np.float32)
    size = flow.shape[1::-1]
    mine, any_hand = (cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0 for mask in (hand, hands))
    if not mine.any() or any_hand.all():
        return np.zeros(hand.shape, np.float32)
    own = flow - background(flow, ~dilate(any_hand, 4))
    pace = _nearest(own, mine)
    speed = np.hypot(pace[..., 0], pace[..., 1])
    width = 0.35 * speed + 0.3
    along, rest = (np.exp(-np.square(own - to).sum(-1) / (2 * width**2)) for to in (pace, np.zeros(2, np.float32)))
    says = cv2.resize(((along - rest) * np.minimum(speed / 2, 1)).astype(np.float32), hand.shape[::-1])
    return says * (cv2.distanceTransform((~hand).astype(np.uint8), cv2.DIST_L2, 3) < far_px)


def own_motion(looks: Looks, k: int) -> np.ndarray:
    """(h, w) float32: how fast what look k shows moves before the background, px of the half size; 0 where nobody knows."""
    flow = _flow(looks, k)
    if flow is None:
        return np.zeros(looks.rgb.shape[1:3], np.float32)
    own = flow - background(flow, np.ones(flow.shape[:2], bool))
    return cv2.resize(np.hypot(own[..., 0], own[..., 1]), looks.rgb.shape[2:0:-1])


def _flow(looks: Looks, k: int) -> np.ndarray | None:
    """To the look after, at the last one to the look before; None where there is only one."""
    return looks.back[k] if looks.forth[k] is None else looks.forth[k]


def _nearest(own: np.ndarray, mine: np.ndarray) -> np.ndarray:
    """(h, w, 2) the motion of the nearest pixel of a hand, a mean of what is near that one."""
    share = cv2.GaussianBlur(mine.astype(np.float32), (0, 0), NEAR_PX)
    mean = cv2.GaussianBlur(own * mine[..., None], (0, 0), NEAR_PX) / np.maximum(share, 1e-6)[..., None]
    return fill_nearest(mean, mine)


def background(flow: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(h, w, 2) flow of the camera's own motion: an affine map, fitted twice, the second time to what agreed with the first.
    free (h, w) bool: where no hand is.
    """
    height, width = free.shape
    y, x = np.mgrid[:height, :width].astype(np.float32)
    terms = np.stack([np.ones_like(x), x / width, y / height], -1)
    chosen = free[::4, ::4].ravel()
    if chosen.sum() < 16:
        return np.zeros_like(flow)
    a, b = terms[::4, ::4].reshape(-1, 3)[chosen], flow[::4, ::4].reshape(-1, 2)[chosen]
    off = np.hypot(*(b - np.median(b, axis=0)).T)
    for _ in range(2):
        kept = off <= np.quantile(off, 0.6)
        fit = np.linalg.lstsq(a[kept], b[kept], rcond=None)[0]
        off = np.hypot(*(b - a @ fit).T)
    return (terms @ fit).astype(np.float32)


def remembered(odds: Sequence[np.ndarray], looks: Looks, weight: float) -> list[np.ndarray]:
    """Log odds (h, w) of every look and those that motion carries to it, from before or from after, whichever says more: a thing
    that was moved, or will be, is one while it rests.

    weight: of what is carried, from one look to the next.
    """
    ways = [_carried(odds, looks, weight, step) for step in (1, -1)]
    return [np.maximum(before, after) for before, after in zip(*ways, strict=True)]


def _carried(odds: Sequence[np.ndarray], looks: Looks, weight: float, step: int) -> list[np.ndarray]:
    out = list(odds)
    for k in range(len(odds))[::step]:
        before = looks.carried(out[k - step], k, step) if 0 <= k - step < len(odds) else None
        if before is not None:
            out[k] = np.clip(odds[k] + weight * before, -MOST, MOST)
    return out
