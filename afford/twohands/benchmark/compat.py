"""Measures of ActAffordance exactly as its released script computes them, including its faults (2HandedAfforder).

For one case, the grey masks of the hands that have a file are united. The measures are IoU, precision ("IoCM"), and Hausdorff
distances of the **first** outer contour only. A case counts only when a true and a predicted file exist, so a method without a
prediction loses nothing. "mAP" is the mean over thresholds of the mean precision; the other measures are those of the most precise
threshold.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial.distance import directed_hausdorff

Grey = np.ndarray | None
"""(h, w) uint8 as in the file, None without a file"""


class CaseScore(NamedTuple):
    """Measures of one case at one threshold."""

    iou: float
    precision: float
    hd_px: float
    """directed, prediction to truth"""
    hd_symmetric_px: float


class Summary(NamedTuple):
    """Measures over all cases, as the script prints them."""

    iou: float
    precision: float
    hd_px: float
    hd_symmetric_px: float
    map: float
    """mean over thresholds of the mean precision"""
    level: float
    """the threshold of the other measures"""
    counted: int
    """cases that count at that threshold"""


def case_score(truth: tuple[np.ndarray, ...], predicted: tuple[Grey, ...]) -> CaseScore | None:
    """Score one case; None where the script skips it.

    `truth` are the masks (h, w) bool of the hands that have one, `predicted` the files of the two hands. Predictions are resized
    bilinearly to the truth, and both are read as `> 0`.
    """
    files = [mask for mask in predicted if mask is not None]
    if not truth or not files:
        return None
    height, width = truth[0].shape
    g = np.logical_or.reduce(truth)
    p = np.logical_or.reduce([cv2.resize(mask, (width, height)) > 0 for mask in files])
    both, union, mine = np.logical_and(g, p).sum(), np.logical_or(g, p).sum(), p.sum()
    directed, symmetric = _hausdorff(g, p)
    return CaseScore(float(both / union) if union else 0.0, float(both / mine) if mine else 0.0, directed, symmetric)


def _hausdorff(truth: np.ndarray, found: np.ndarray) -> tuple[float, float]:
    """Hausdorff distances of the first contours: the diagonal for an empty prediction, else 0 for an empty truth."""
    mine, theirs = _first_contour(found), _first_contour(truth)
    if mine is None:
        diagonal = float(np.sqrt(found.shape[0] ** 2 + found.shape[1] ** 2))
        return diagonal, diagonal
    if theirs is None:
        return 0.0, 0.0
    directed = directed_hausdorff(mine, theirs)[0]
    return directed, max(directed, directed_hausdorff(theirs, mine)[0])


def _first_contour(mask: np.ndarray) -> np.ndarray | None:
    """Corners (n, 2) x, y of the first outer contour."""
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return np.asarray(found[0]).reshape(-1, 2) if found else None


def summary(scores: np.ndarray, level: tuple[float, ...]) -> Summary | None:
    """Summarise scores (n, l, 4) of cases and thresholds, NaN where skipped.

    None when a threshold has no case, where the script divides by zero.
    """
    counted = np.isfinite(scores[..., 0]).sum(axis=0)
    if not len(counted) or not counted.all():
        return None
    means = np.nansum(scores, axis=0) / counted[:, None]
    best = int(np.argmax(means[:, 1]))
    iou, precision, directed, symmetric = (float(value) for value in means[best])
    return Summary(iou, precision, directed, symmetric, float(means[:, 1].mean()), level[best], int(counted[best]))
