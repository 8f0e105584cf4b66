"""Whether probabilities mean what they say: per bin, mean probability beside the share that is true."""

from __future__ import annotations

import cv2
import numpy as np

BINS = 15


def reliability(probability: np.ndarray, share: np.ndarray, of: int, floor: float) -> np.ndarray:
    """(3, BINS) per bin: pixels, summed probability, summed truth. `probability` (h, w) is 0..1, rounded to 1/255; `share` (h, w)
    uint8 counts how many `of` the valid ways hold the pixel.

    Pixels below `floor` are left out: nearly every pixel of an image is certain background, which would hide the rest. The
    choice looks at the prediction alone, so that it does not bend the curve.
    """
    grey = np.rint(probability * np.float32(255)).astype(np.uint8)
    joint = cv2.calcHist([grey, share], [0, 1], None, [256, of + 1], [0, 256, 0, of + 1]).astype(np.float64)
    p = np.arange(256) / 255
    joint[p < floor] = 0
    count, truth = joint.sum(axis=1), joint @ (np.arange(of + 1) / of)
    return binned(p, np.stack([count, count * p, truth]))


def binned(p: np.ndarray, table: np.ndarray) -> np.ndarray:
    """(3, n) sums at n probabilities -> (3, BINS)."""
    bins = np.minimum((p * BINS).astype(np.int64), BINS - 1)
    return np.stack([np.bincount(bins, weights, BINS) for weights in table])


def expected_error(table: np.ndarray) -> float:
    """Expected calibration error of a (3, b) table (Guo et al. 2017): the mean gap, weighted by pixels. NaN without any."""
    count, probability, truth = table
    total = count.sum()
    return float(np.abs(probability - truth).sum() / total) if total else float("nan")
