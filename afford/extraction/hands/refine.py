"""Refinement of the probabilities of single pictures: smoothing over time, colours of the clip, image edges, GrabCut."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from afford.extraction.hands.motion import SampledFrames

BINS_LAB = (8, 32, 32)
"""bins of lightness and of the two colour axes of CIE Lab"""
SURE, RULED_OUT = 0.7, 0.15
"""pixels above the first probability are samples of hand colours, pixels below the second of other colours"""
LEAST_SHARE = 2e-4
"""least share of pixels that are certainly hands, for a colour model"""
MAX_COLOUR_ODDS = 2.5
"""largest log odds of the colour model"""
EDGE = 1e-3
"""variance of grey (0..1) from which the guided filter keeps an edge"""


def smooth_over_time(seen: np.ndarray, sampled: SampledFrames, weight: float) -> np.ndarray:
    """Smooth probabilities (k, h, w) float16 over time: blend each sampled frame with its neighbours, warped by motion.

    weight: of the neighbour, against 1 for the frame itself.
    """
    directions = [_smooth_direction(seen, sampled, weight, step) for step in (1, -1)]
    return ((directions[0].astype(np.float32) + directions[1]) / 2).astype(np.float16)


def _smooth_direction(seen: np.ndarray, sampled: SampledFrames, weight: float, step: int) -> np.ndarray:
    out = seen.copy()
    for k in range(len(seen))[::step]:
        before = sampled.warp(out[k - step].astype(np.float32), k, step) if 0 <= k - step < len(seen) else None
        if before is not None:
            out[k] = (seen[k] + weight * before) / (1 + weight)
    return out


def refine_by_colour(hand: np.ndarray, rgb: np.ndarray, weight: float, rounds: int = 2) -> np.ndarray:
    """Refine hand probabilities (k, h, w) by a colour model of the hands of this clip; unchanged with too few certain pixels.

    weight: of the colour model, against 1 for the hand finder, in log odds.
    """
    bins = np.stack([colour_bins(picture) for picture in rgb])
    found = hand
    for _ in range(rounds):
        odds = _colour_odds(bins, found)
        if odds is None:
            return hand
        found = np.stack([_combine_odds(p, odds[where], weight) for p, where in zip(hand, bins, strict=True)])
    return found


def colour_bins(rgb: np.ndarray, blur_px: float = 1.0) -> np.ndarray:
    """Colour bin (h, w) uint16 of every pixel."""
    lab = cv2.cvtColor(cv2.GaussianBlur(rgb, (0, 0), blur_px), cv2.COLOR_RGB2LAB).astype(np.uint16)
    light, a, b = (lab[..., i] * n >> 8 for i, n in enumerate(BINS_LAB))
    return (light * BINS_LAB[1] + a) * BINS_LAB[2] + b


def _colour_odds(bins: np.ndarray, hand: np.ndarray) -> np.ndarray | None:
    """Log odds of a hand for every colour bin; None with too few certain pixels of either class."""
    sure, out = hand > SURE, hand < RULED_OUT
    if min(sure.mean(), out.mean()) < LEAST_SHARE:
        return None
    counted = (np.bincount(bins[chosen].ravel(), minlength=int(np.prod(BINS_LAB))) for chosen in (sure, out))
    inside, outside = (histogram_density(counts) for counts in counted)
    floor = 0.02 / inside.size
    return np.clip(np.log(inside + floor) - np.log(outside + floor), -MAX_COLOUR_ODDS, MAX_COLOUR_ODDS).astype(np.float32)


def histogram_density(counts: np.ndarray) -> np.ndarray:
    """Density over colour bins, slightly smoothed, that sums to about 1, from the count (n,) of every bin."""
    counts = counts.astype(np.float32).reshape(BINS_LAB)
    total = max(float(counts.sum()), 1e-6)
    counts = np.stack([cv2.GaussianBlur(plane, (0, 0), 1.0, borderType=cv2.BORDER_CONSTANT) for plane in counts])
    light = np.pad(counts, ((1, 1), (0, 0), (0, 0)))
    return np.asarray(((light[:-2] + 2 * light[1:-1] + light[2:]) / (4 * total)).ravel())


def _combine_odds(p: np.ndarray, odds: np.ndarray, weight: float) -> np.ndarray:
    sure = np.clip(p.astype(np.float32), 0.01, 0.99)
    return (1 / (1 + np.exp(-np.log(sure / (1 - sure)) - weight * odds))).astype(np.float16)


def guided_filter(p: np.ndarray, rgb: np.ndarray, radius_px: int) -> np.ndarray:
    """Align the steps of probabilities (h, w) with image edges: the guided filter (He et al. 2010) on grey."""
    guide, image = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255, p.astype(np.float32)
    size = (2 * radius_px + 1, 2 * radius_px + 1)
    mean, other = cv2.blur(guide, size), cv2.blur(image, size)
    slope = (cv2.blur(guide * image, size) - mean * other) / (cv2.blur(guide * guide, size) - mean * mean + EDGE)
    return cv2.blur(slope, size) * guide + cv2.blur(other - slope * mean, size)


def components(mask: np.ndarray, least_px: float, least_wide_px: int = 3) -> Sequence[np.ndarray]:
    """Connected components of a mask (h, w) bool of at least `least_px` pixels, after opening by `least_wide_px`."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (least_wide_px, least_wide_px))
    smooth = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, disc)
    count, label, stats, _ = cv2.connectedComponentsWithStats(smooth, connectivity=4)
    return [label == i for i in range(1, count) if stats[i, cv2.CC_STAT_AREA] >= least_px]


PROBABLE, CERTAIN, EXCLUDED = 2.0, 4.0, -1.0
"""log odds above which pixels are probable or certain foreground, and below which they are certain background"""
MARGIN_PX, LEAST_PX = 24, 30
"""margin around the possible foreground, and least area of it"""


def segment_grabcut(odds: np.ndarray, rgb: np.ndarray, never: np.ndarray) -> np.ndarray:
    """Segment an object by GrabCut, (h, w) bool, outside the mask `never` (h, w) bool.

    odds: (h, w) float32, log odds of the object; rgb: (h, w, 3) uint8.
    """
    label = _labels(odds, never)
    out = np.zeros(odds.shape, bool)
    if LEAST_PX <= (label & cv2.GC_FGD).sum() < label.size:
        y, x = np.nonzero(label & cv2.GC_FGD)
        box = tuple(slice(max(at.min() - MARGIN_PX, 0), at.max() + MARGIN_PX) for at in (y, x))
        out[box] = _cut(np.ascontiguousarray(rgb[box]), np.ascontiguousarray(label[box]))
    return out & ~never


def _labels(odds: np.ndarray, never: np.ndarray) -> np.ndarray:
    label = np.full(odds.shape, cv2.GC_PR_BGD, np.uint8)
    label[odds > PROBABLE] = cv2.GC_PR_FGD
    label[odds > CERTAIN] = cv2.GC_FGD
    label[(odds < EXCLUDED) | never] = cv2.GC_BGD
    return label


def _cut(rgb: np.ndarray, label: np.ndarray) -> np.ndarray:
    """Run GrabCut, (h, w) bool. OpenCV's random generator gets a fixed seed, because GrabCut initialises its mixtures from it."""
    if (label & cv2.GC_FGD).all():
        return np.ones(label.shape, bool)
    cv2.setRNGSeed(0)
    cv2.grabCut(rgb, label, None, np.zeros((1, 65)), np.zeros((1, 65)), 1, cv2.GC_INIT_WITH_MASK)
    return (label & cv2.GC_FGD) > 0
