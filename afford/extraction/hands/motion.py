"""Sampled frames of a clip with the flow between them, and motion cues: motion with a hand, camera motion, propagated odds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.masks import dilate, fill_nearest
from afford.common.optical_flow import flow_between, identity_map
from afford.extraction.tracks.key_frames import evenly_spaced
from afford.extraction.tracks.key_frames import runs as split_runs
from schemas.video import Frames


@dataclass(frozen=True)
class SampledFrames:
    """Frames of a clip sampled for hand detection, and the flow between them at half their size."""

    at: np.ndarray
    """(k,) positions in `Frames.frame`, ascending"""
    rgb: np.ndarray
    """(k, h, w, 3) uint8"""
    time_s: np.ndarray
    """(k,) seconds from the start of the video"""
    back: list[np.ndarray | None]
    """flow from each sampled frame to the previous one, px of the half size; None across a gap of the video"""
    forth: list[np.ndarray | None]
    """flow from each sampled frame to the next one"""

    @property
    def runs(self) -> list[range]:
        """Runs of sampled frames without a gap or a cut in the video."""
        cuts = [k for k, flow in enumerate(self.back) if flow is None]
        return [range(a, b) for a, b in zip(cuts, [*cuts[1:], len(self.at)], strict=True)]

    def warp(self, image: np.ndarray, k: int, step: int) -> np.ndarray | None:
        """Warp an image (h, w) float32 from sampled frame k - step to k; `step` is 1 or -1. None across a gap of the video."""
        flow = self.back[k] if step == 1 else self.forth[k]
        return None if flow is None else _warp(image, flow)


THUMBNAIL, COLOUR_BINS = (32, 18), 16
CUT_LEVELS, CUT_SHARE = 25.0, 0.7
"""a cut changes small blurred pictures by more than this on average, 0..255, and keeps less than this share of their colours"""


def sample_frames(frames: Frames, every_s: float, numbers: np.ndarray | None = None) -> SampledFrames:
    """Sample frames about `every_s` apart, including the first and the last of every run, or the frames of these `numbers`."""
    parts = split_runs(frames.frame, 1)
    if numbers is None:
        chosen = [evenly_spaced(frames.time_ns[part] / 1e9, every_s) + part.start for part in parts]
    else:
        there = np.flatnonzero(np.isin(frames.frame, numbers))
        chosen = [part for part in (there[(there >= one.start) & (there < one.stop)] for one in parts) if len(part)]
    at = np.concatenate(chosen)
    grey = [cv2.cvtColor(_half(rgb), cv2.COLOR_RGB2GRAY) for rgb in frames.rgb[at]]
    starts = set(np.cumsum([0, *map(len, chosen)]).tolist()) | cuts(frames.rgb[at])
    back, forth = list(_flows(grey, starts, -1)), list(_flows(grey, starts, 1))
    return SampledFrames(at, frames.rgb[at], frames.time_ns[at] / 1e9, back, forth)


def cuts(rgb: np.ndarray) -> set[int]:
    """Find the first frames of new shots in (k, h, w, 3) uint8: other colours in the whole, and another picture at every place."""
    tiny = (cv2.resize(one, THUMBNAIL, interpolation=cv2.INTER_AREA) for one in rgb)
    small = [cv2.GaussianBlur(one, (0, 0), 1.0).astype(np.float32) for one in tiny]
    shares = [np.stack([np.histogram(one[..., c], COLOUR_BINS, (0, 256))[0] / one[..., c].size for c in range(3)]) for one in small]
    return {k for k in range(1, len(small))
            if np.abs(small[k] - small[k - 1]).mean() > CUT_LEVELS
            and np.minimum(shares[k], shares[k - 1]).sum(1).mean() < CUT_SHARE}  # fmt: skip


def _half(rgb: np.ndarray) -> np.ndarray:
    return cv2.resize(rgb, (max(rgb.shape[1] // 2, 16), max(rgb.shape[0] // 2, 16)), interpolation=cv2.INTER_AREA)


def _flows(grey: list[np.ndarray], starts: set[int], step: int) -> Iterator[np.ndarray | None]:
    """Flow from every sampled frame to its neighbour `step` away; `starts` are the first frames of runs, and the total number."""
    for k, image in enumerate(grey):
        apart = (k if step == -1 else k + 1) in starts
        yield None if apart else flow_between(image, grey[k + step], "fast")


def _warp(image: np.ndarray, flow: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    scale = np.array([width / flow.shape[1], height / flow.shape[0]], np.float32)
    where = identity_map(height, width) + cv2.resize(flow, (width, height)) * scale
    return cv2.remap(image, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


NEAR_PX = 6.0
"""blur of the motion of a hand, px of flow; the arm may move differently"""
MAX_ODDS = 8.0
"""largest propagated log odds"""


def comotion(sampled: SampledFrames, k: int, hand: np.ndarray, hands: np.ndarray, far_px: float) -> np.ndarray:
    """Score motion with a hand, (h, w) float32: near 1 for pixels that move with the nearest part of a moving hand.

    The score is near -1 for pixels that move with the background, else near 0, and 0 farther than `far_px` from the hand.
    hand: (h, w) bool; hands: (h, w) bool, all hands of sampled frame k.
    """
    flow = _flow(sampled, k)
    if flow is None:
        return np.zeros(hand.shape, np.float32)
    size = flow.shape[1::-1]
    inside, any_hand = (cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0 for mask in (hand, hands))
    if not inside.any() or any_hand.all():
        return np.zeros(hand.shape, np.float32)
    own = flow - camera_flow(flow, ~dilate(any_hand, 4))
    pace = _nearest_hand_motion(own, inside)
    speed = np.hypot(pace[..., 0], pace[..., 1])
    width = 0.35 * speed + 0.3
    along, rest = (np.exp(-np.square(own - to).sum(-1) / (2 * width**2)) for to in (pace, np.zeros(2, np.float32)))
    score = cv2.resize(((along - rest) * np.minimum(speed / 2, 1)).astype(np.float32), hand.shape[::-1])
    return score * (cv2.distanceTransform((~hand).astype(np.uint8), cv2.DIST_L2, 3) < far_px)


def residual_speed(sampled: SampledFrames, k: int) -> np.ndarray:
    """Speed (h, w) float32 of each pixel of sampled frame k relative to the background, px of the half size; 0 without flow."""
    flow = _flow(sampled, k)
    if flow is None:
        return np.zeros(sampled.rgb.shape[1:3], np.float32)
    own = flow - camera_flow(flow, np.ones(flow.shape[:2], bool))
    return cv2.resize(np.hypot(own[..., 0], own[..., 1]), sampled.rgb.shape[2:0:-1])


def _flow(sampled: SampledFrames, k: int) -> np.ndarray | None:
    """Flow to the next sampled frame, at the last one to the previous; None for a single frame."""
    return sampled.back[k] if sampled.forth[k] is None else sampled.forth[k]


def _nearest_hand_motion(own: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Blurred motion (h, w, 2) at the nearest pixel of a hand."""
    share = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), NEAR_PX)
    mean = cv2.GaussianBlur(own * inside[..., None], (0, 0), NEAR_PX) / np.maximum(share, 1e-6)[..., None]
    return fill_nearest(mean, inside)


def camera_flow(flow: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Fit the flow (h, w, 2) of the camera motion: an affine map, fitted twice to the flow that agrees best.

    free: (h, w) bool, pixels without hands.
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


SAME_COLOUR = 60.0
"""mean difference of colours (sum over the channels) at which odds of the previous sampled frame are half propagated"""


def propagate_odds(odds: Sequence[np.ndarray], sampled: SampledFrames, weight: float) -> list[np.ndarray]:
    """Propagate log odds (h, w) over time by motion, forwards and backwards, where colours agree; the larger of both counts.

    So an object that was moved, or will be, stays an object while it rests, and the place that it leaves becomes background.
    weight: of the odds of the previous sampled frame.
    """
    directions = [_propagate_direction(odds, sampled, weight, step) for step in (1, -1)]
    return [np.maximum(before, after) for before, after in zip(*directions, strict=True)]


def _propagate_direction(odds: Sequence[np.ndarray], sampled: SampledFrames, weight: float, step: int) -> list[np.ndarray]:
    out = list(odds)
    for k in range(len(odds))[::step]:
        before = sampled.warp(out[k - step], k, step) if 0 <= k - step < len(odds) else None
        if before is not None:
            out[k] = np.clip(odds[k] + weight * before * same_colour(sampled, k, step), -MAX_ODDS, MAX_ODDS)
    return out


def same_colour(sampled: SampledFrames, k: int, step: int) -> np.ndarray:
    """Score (h, w) float32 from 0 to 1 the agreement of colours of sampled frame k with frame k - step, warped by motion."""
    warped = [sampled.warp(sampled.rgb[k - step, ..., c].astype(np.float32), k, step) for c in range(3)]
    apart = cv2.blur(sum(np.abs(one - sampled.rgb[k, ..., c]) for c, one in enumerate(warped)), (5, 5))
    agreement: np.ndarray = 1 / (1 + (apart / SAME_COLOUR) ** 4)
    return agreement
