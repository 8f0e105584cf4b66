"""Strict measures of regions, several valid modes, and calibration.

Masks are (h, w) bool of one shape; the truth is never empty. Every case counts: a method that returns nothing scores 0, and the
diagonal of the image as its distance. Distances are exact Euclidean between all pixels of two masks, in px. A mode, like a
hypothesis, is a pair of regions, one for each hand.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from afford.common.masks import box, iou


def best_mode(found: np.ndarray, modes: np.ndarray) -> int:
    """Index of the mode whose union of both hands has the best IoU with `found` (h, w); `modes` (m, 2, h, w) bool."""
    return int(np.argmax([iou(found, mode[0] | mode[1]) for mode in modes]))


def agreement(hypotheses: np.ndarray, modes: np.ndarray) -> np.ndarray:
    """IoU (k, m) of the united hands of each hypothesis (k, 2, h, w) with those of each mode (m, 2, h, w)."""
    truth = [mode[0] | mode[1] for mode in modes]
    return np.array([[iou(one[0] | one[1], mode) for mode in truth] for one in hypotheses])


def best_mode_iou(table: np.ndarray) -> float:
    """Mean over modes of the IoU of the best hypothesis for each, from `table` (k, m); 1 only when every mode is found."""
    return float(table.max(axis=0).mean())


def best_hypothesis_iou(table: np.ndarray) -> float:
    """IoU of the best pair in `table` (k, m), which a perfect ranking of the hypotheses would give."""
    return float(table.max())


BINS = 15


def reliability(probability: np.ndarray, share: np.ndarray, of: int, floor: float) -> np.ndarray:
    """Calibration table (3, BINS): pixels, summed probability and summed truth of each bin.

    `probability` (h, w) is 0..1, rounded to 1/255; `share` (h, w) uint8 counts the valid modes, out of `of`, that contain a pixel.
    Pixels below `floor` are left out, because nearly every pixel is certain background, which would hide the others. This choice
    depends on the prediction alone, so that it does not bias the curve.
    """
    grey = np.rint(probability * np.float32(255)).astype(np.uint8)
    joint = cv2.calcHist([grey, share], [0, 1], None, [256, of + 1], [0, 256, 0, of + 1]).astype(np.float64)
    p = np.arange(256) / 255
    joint[p < floor] = 0
    count, truth = joint.sum(axis=1), joint @ (np.arange(of + 1) / of)
    return binned(p, np.stack([count, count * p, truth]))


def binned(p: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Sum a table (3, n) at n probabilities into bins: (3, BINS)."""
    bins = np.minimum((p * BINS).astype(np.int64), BINS - 1)
    return np.stack([np.bincount(bins, weights, BINS) for weights in table])


def expected_error(table: np.ndarray) -> float:
    """Expected calibration error of a table (3, b) (Guo et al. 2017), the mean gap weighted by pixels; NaN without pixels."""
    count, probability, truth = table
    total = count.sum()
    return float(np.abs(probability - truth).sum() / total) if total else float("nan")


class Overlap(NamedTuple):
    """Overlap of two regions, 0..1."""

    iou: float
    precision: float
    recall: float
    f1: float


class Hausdorff(NamedTuple):
    """Hausdorff distances in px."""

    directed: float
    """largest distance of a found pixel from the truth"""
    symmetric: float
    """maximum of the directed distances in both directions"""


def overlap(found: np.ndarray, truth: np.ndarray) -> Overlap:
    """Compute IoU, precision, recall and F1; all 0 when one mask is empty."""
    both, mine, theirs = (int(np.count_nonzero(mask)) for mask in (found & truth, found, truth))
    if both == 0:
        return Overlap(0.0, 0.0, 0.0, 0.0)
    return Overlap(both / (mine + theirs - both), both / mine, both / theirs, 2 * both / (mine + theirs))


def precision(found: np.ndarray, truth: np.ndarray) -> float:
    """Share of the found pixels that are true; 0 for an empty prediction."""
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
