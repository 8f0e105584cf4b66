"""Which frames of a clip are looked at for hands, and how pixels move from each of them to the next."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.masks import dilate, fill_nearest
from afford.common.optical_flow import flow_between, identity_map
from afford.extraction.tracks.key_frames import runs
from schemas.video import Frames


@dataclass(frozen=True)
class Looks:
    """Frames that are looked at. Motion is known at half their size."""

    at: np.ndarray
    """(k,) positions in `Frames.frame`, ascending"""
    rgb: np.ndarray
    """(k, h, w, 3) uint8"""
    time_s: np.ndarray
    """(k,) seconds from the start of the video"""
    back: list[np.ndarray | None]
    """flow from each to the one before, px of the half size; None where no video joins the two"""
    forth: list[np.ndarray | None]
    """flow from each to the next"""

    @property
    def stretches(self) -> list[range]:
        """Looks that a video joins."""
        cuts = [k for k, flow in enumerate(self.back) if flow is None]
        return [range(a, b) for a, b in zip(cuts, [*cuts[1:], len(self.at)], strict=True)]

    def carried(self, image: np.ndarray, k: int, step: int) -> np.ndarray | None:
        """What look k - step shows, (h, w) float32, where it is in look k; `step` is 1 or -1. None where nothing joins the two."""
        flow = self.back[k] if step == 1 else self.forth[k]
        return None if flow is None else _pulled(image, flow)


def look(frames: Frames, every_s: float) -> Looks:
    """Frames about `every_s` apart, the first and the last of every unbroken stretch among them."""
    chosen = [spread(frames.time_ns[part] / 1e9, every_s) + part.start for part in runs(frames.frame, 1)]
    at = np.concatenate(chosen)
    grey = [cv2.cvtColor(_half(rgb), cv2.COLOR_RGB2GRAY) for rgb in frames.rgb[at]]
    starts = set(np.cumsum([0, *map(len, chosen)]).tolist())
    back, forth = list(_flows(grey, starts, -1)), list(_flows(grey, starts, 1))
    return Looks(at, frames.rgb[at], frames.time_ns[at] / 1e9, back, forth)


def spread(time_s: np.ndarray, every_s: float) -> np.ndarray:
    """Positions among times (n,), ascending, that are about `every_s` apart; the first and the last are among them."""
    count = max(round((time_s[-1] - time_s[0]) / every_s), 1) + 1
    wanted = np.linspace(time_s[0], time_s[-1], count)
    return np.unique(np.abs(time_s[:, None] - wanted).argmin(0))


def _half(rgb: np.ndarray) -> np.ndarray:
    return cv2.resize(rgb, (max(rgb.shape[1] // 2, 16), max(rgb.shape[0] // 2, 16)), interpolation=cv2.INTER_AREA)


def _flows(grey: list[np.ndarray], starts: set[int], step: int) -> Iterator[np.ndarray | None]:
    """Flow from every look to its neighbour `step` away; `starts` are the first looks of stretches, and the number of looks."""
    for k, image in enumerate(grey):
        apart = (k if step == -1 else k + 1) in starts
        yield None if apart else flow_between(image, grey[k + step], "fast")


def _pulled(image: np.ndarray, flow: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    scale = np.array([width / flow.shape[1], height / flow.shape[0]], np.float32)
    where = identity_map(height, width) + cv2.resize(flow, (width, height)) * scale
    return cv2.remap(image, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


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
