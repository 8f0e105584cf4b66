"""From where something may be to its outline: GrabCut (Rother et al. 2004), begun where that is clear."""

from __future__ import annotations

import cv2
import numpy as np

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
