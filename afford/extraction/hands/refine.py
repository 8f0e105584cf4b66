"""What a finder says of single pictures, made better by the clip they belong to: by motion, by its own skin colour, by edges."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from afford.extraction.hands.motion import Looks

BINS_LAB = (8, 32, 32)
"""bins of lightness and of the two colour axes of CIE Lab"""
SURE, RULED_OUT = 0.7, 0.15
"""probabilities from which pixels teach the colours of hands, and below which those of everything else"""
LEAST_SHARE = 2e-4
"""of all pixels, that must be surely hand before colours are learned"""
ODDS = 2.5
"""most that colour says for or against a hand, in log odds"""
EDGE = 1e-3
"""variance of grey (0..1) from which the guided filter keeps an edge"""


def steadied(seen: np.ndarray, looks: Looks, weight: float) -> np.ndarray:
    """Probabilities (k, h, w) float16 of every look, each mixed with those that motion carries to it from before and from after.

    weight: of what is carried, against 1 for what is seen.
    """
    ways = [_passed_on(seen, looks, weight, step) for step in (1, -1)]
    return ((ways[0].astype(np.float32) + ways[1]) / 2).astype(np.float16)


def _passed_on(seen: np.ndarray, looks: Looks, weight: float, step: int) -> np.ndarray:
    out = seen.copy()
    for k in range(len(seen))[::step]:
        before = looks.carried(out[k - step].astype(np.float32), k, step) if 0 <= k - step < len(seen) else None
        if before is not None:
            out[k] = (seen[k] + weight * before) / (1 + weight)
    return out


def coloured(hand: np.ndarray, rgb: np.ndarray, weight: float, rounds: int = 2) -> np.ndarray:
    """Probabilities (k, h, w) of hands, made to agree with the colours that hands of this clip have; as they are where too little
    is surely a hand.

    weight: of colour, against 1 for what the finder says, in log odds.
    """
    bins = np.stack([_bins(picture) for picture in rgb])
    found = hand
    for _ in range(rounds):
        odds = _odds(bins, found)
        if odds is None:
            return hand
        found = np.stack([_both(p, odds[where], weight) for p, where in zip(hand, bins, strict=True)])
    return found


def _bins(rgb: np.ndarray) -> np.ndarray:
    """(h, w) uint16: the bin of every pixel's colour."""
    lab = cv2.cvtColor(cv2.GaussianBlur(rgb, (0, 0), 1), cv2.COLOR_RGB2LAB).astype(np.uint16)
    light, a, b = (lab[..., i] * n >> 8 for i, n in enumerate(BINS_LAB))
    return (light * BINS_LAB[1] + a) * BINS_LAB[2] + b


def _odds(bins: np.ndarray, hand: np.ndarray) -> np.ndarray | None:
    """Log odds of a hand for every colour; None where hardly anything is surely a hand, or everything is."""
    sure, out = hand > SURE, hand < RULED_OUT
    if min(sure.mean(), out.mean()) < LEAST_SHARE:
        return None
    inside, outside = (_density(bins[chosen]) for chosen in (sure, out))
    floor = 0.02 / inside.size
    return np.clip(np.log(inside + floor) - np.log(outside + floor), -ODDS, ODDS).astype(np.float32)


def _density(bins: np.ndarray) -> np.ndarray:
    """Share of every colour, spread a little to its neighbours."""
    counts = np.bincount(bins.ravel(), minlength=int(np.prod(BINS_LAB))).astype(np.float32).reshape(BINS_LAB)
    counts = np.stack([cv2.GaussianBlur(plane, (0, 0), 1.0, borderType=cv2.BORDER_CONSTANT) for plane in counts])
    light = np.pad(counts, ((1, 1), (0, 0), (0, 0)))
    return ((light[:-2] + 2 * light[1:-1] + light[2:]) / (4 * max(counts.sum(), 1))).ravel()


def _both(p: np.ndarray, odds: np.ndarray, weight: float) -> np.ndarray:
    sure = np.clip(p.astype(np.float32), 0.01, 0.99)
    return (1 / (1 + np.exp(-np.log(sure / (1 - sure)) - weight * odds))).astype(np.float16)


def along_edges(p: np.ndarray, rgb: np.ndarray, radius_px: int) -> np.ndarray:
    """Probabilities (h, w) whose steps lie where the picture has them: the guided filter (He et al. 2010) on grey."""
    guide, image = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255, p.astype(np.float32)
    size = (2 * radius_px + 1, 2 * radius_px + 1)
    mean, other = cv2.blur(guide, size), cv2.blur(image, size)
    slope = (cv2.blur(guide * image, size) - mean * other) / (cv2.blur(guide * guide, size) - mean * mean + EDGE)
    return cv2.blur(slope, size) * guide + cv2.blur(other - slope * mean, size)


def pieces(mask: np.ndarray, least_px: float, least_wide_px: int = 3) -> Sequence[np.ndarray]:
    """Connected parts of a mask (h, w) bool of at least `least_px` pixels, without what is narrower than `least_wide_px`."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (least_wide_px, least_wide_px))
    smooth = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, disc)
    count, label, stats, _ = cv2.connectedComponentsWithStats(smooth, connectivity=4)
    return [label == i for i in range(1, count) if stats[i, cv2.CC_STAT_AREA] >= least_px]


MAY_BE, IS, IS_NOT = 2.0, 4.0, -1.0
"""log odds from which pixels are probably and surely the thing, and below which they are surely not"""
SHRINK = 2
"""outlines are found in the picture at this part of its size"""
MARGIN_PX, LEAST_PX = 12, 20
"""there: around what may be the thing, and how much of it there must be"""


def outlined(odds: np.ndarray, rgb: np.ndarray, never: np.ndarray) -> np.ndarray:
    """(h, w) bool: the thing, and nothing where `never` (h, w) bool says so. odds (h, w) float32: log odds of it; rgb (h, w, 3)."""
    height, width = odds.shape
    size = max(width // SHRINK, 1), max(height // SHRINK, 1)
    label = _labels(*(cv2.resize(image, size, interpolation=how) for image, how in (
        (odds, cv2.INTER_AREA), (never.astype(np.uint8), cv2.INTER_NEAREST))))  # fmt: skip
    out = np.zeros(label.shape, np.float32)
    if LEAST_PX <= (label & cv2.GC_FGD).sum() < label.size:
        y, x = np.nonzero(label & cv2.GC_FGD)
        box = tuple(slice(max(at.min() - MARGIN_PX, 0), at.max() + MARGIN_PX) for at in (y, x))
        small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA)
        out[box] = _cut(np.ascontiguousarray(small[box]), np.ascontiguousarray(label[box]))
    return (cv2.resize(out, (width, height)) > 0.5) & ~never


def _labels(odds: np.ndarray, never: np.ndarray) -> np.ndarray:
    label = np.full(odds.shape, cv2.GC_PR_BGD, np.uint8)
    label[odds > MAY_BE] = cv2.GC_PR_FGD
    label[odds > IS] = cv2.GC_FGD
    label[(odds < IS_NOT) | (never > 0)] = cv2.GC_BGD
    return label


def _cut(rgb: np.ndarray, label: np.ndarray) -> np.ndarray:
    """(h, w) bool. The mixtures of colours begin with draws of OpenCV's own generator, which gets the same seed every time."""
    cv2.setRNGSeed(0)
    cv2.grabCut(rgb, label, None, np.zeros((1, 65)), np.zeros((1, 65)), 1, cv2.GC_INIT_WITH_MASK)
    return (label & cv2.GC_FGD) > 0
