"""Strict measures between two regions of one image. Masks are (h, w) bool of one shape; the truth is never empty.

Every case counts: a method that returns nothing scores 0, and the image's diagonal as its distance. Distances are between all
pixels of the two masks, in px of the grid, exact Euclidean.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from afford.common.masks import box


class Overlap(NamedTuple):
    """Shares of pixels, 0..1."""

    iou: float
    precision: float
    recall: float
    f1: float


class Hausdorff(NamedTuple):
    """px."""

    directed: float
    """farthest that any found pixel lies from the truth"""
    symmetric: float
    """the larger of that and the farthest that any true pixel lies from what was found"""


def overlap(found: np.ndarray, truth: np.ndarray) -> Overlap:
    """IoU, precision, recall and F1; all 0 when one mask is empty."""
    both, mine, theirs = (int(np.count_nonzero(mask)) for mask in (found & truth, found, truth))
    if both == 0:
        return Overlap(0.0, 0.0, 0.0, 0.0)
    return Overlap(both / (mine + theirs - both), both / mine, both / theirs, 2 * both / (mine + theirs))


def precision(found: np.ndarray, truth: np.ndarray) -> float:
    """Share of the found pixels that are true; 0 when nothing is found."""
    mine = np.count_nonzero(found)
    return np.count_nonzero(found & truth) / mine if mine else 0.0


def hausdorff(found: np.ndarray, truth: np.ndarray) -> Hausdorff:
    """Directed and symmetric distance; the diagonal of the image when one mask is empty."""
    if not found.any() or not truth.any():
        diagonal = float(np.hypot(*found.shape))
        return Hausdorff(diagonal, diagonal)
    near = box(found | truth)
    found, truth = found[near], truth[near]
    directed = _farthest(found, truth)
    return Hausdorff(directed, max(directed, _farthest(truth, found)))


def _farthest(pixels: np.ndarray, region: np.ndarray) -> float:
    """Largest distance of a pixel from the region."""
    outside = (~region).view(np.uint8)
    return float(cv2.distanceTransform(outside, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[pixels].max())
