"""ActAffordance's measures exactly as its released script computes them, faults included (2HandedAfforder).

One case: grey masks of the hands for which a file exists -> union -> IoU, precision ("IoCM"), Hausdorff distances of the
**first** outer contour only. A case counts only when a true and a predicted file exist: a method that predicts nothing for it is
not punished. Over thresholds: "mAP" is the mean of mean precisions, the other measures are those of the most precise threshold.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial.distance import directed_hausdorff

Grey = np.ndarray | None
"""(h, w) uint8 as the file has it, None where there is no file"""


class CaseScore(NamedTuple):
    """One case at one threshold."""

    iou: float
    precision: float
    hd_px: float
    """directed, prediction to truth"""
    hd_symmetric_px: float


class Summary(NamedTuple):
    """What the script prints."""

    iou: float
    precision: float
    hd_px: float
    hd_symmetric_px: float
    map: float
    """mean over thresholds of the mean precision"""
    level: float
    """the threshold of the other measures"""
    counted: int
    """cases at that threshold"""


def case_score(truth: tuple[np.ndarray, ...], predicted: tuple[Grey, ...]) -> CaseScore | None:
    """Score of one case: `truth` are the (h, w) bool masks of the hands that have one, `predicted` the two hands' files. None
    where the script skips. Predictions are resized bilinearly to the truth, and both read as `> 0`.
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
    """Between first contours; the diagonal when nothing was found, else 0 when nothing is true."""
    mine, theirs = _first_contour(found), _first_contour(truth)
    if mine is None:
        diagonal = float(np.sqrt(found.shape[0] ** 2 + found.shape[1] ** 2))
        return diagonal, diagonal
    if theirs is None:
        return 0.0, 0.0
    directed = directed_hausdorff(mine, theirs)[0]
    return directed, max(directed, directed_hausdorff(theirs, mine)[0])


def _first_contour(mask: np.ndarray) -> np.ndarray | None:
    """(n, 2) x, y corners."""
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return np.asarray(found[0]).reshape(-1, 2) if found else None


def summary(scores: np.ndarray, level: tuple[float, ...]) -> Summary | None:
    """(n, l, 4) of cases and thresholds, NaN where skipped -> the printed numbers; None when a threshold has no case (the
    script divides by zero there).
    """
    counted = np.isfinite(scores[..., 0]).sum(axis=0)
    if not len(counted) or not counted.all():
        return None
    means = np.nansum(scores, axis=0) / counted[:, None]
    best = int(np.argmax(means[:, 1]))
    iou, precision, directed, symmetric = (float(value) for value in means[best])
    return Summary(iou, precision, directed, symmetric, float(means[:, 1].mean()), level[best], int(counted[best]))
