"""Whether probabilities mean what they say: per bin, mean probability beside the share that is true."""

from __future__ import annotations

import numpy as np

BINS = 15


def reliability(probability: np.ndarray, truth: np.ndarray, floor: float) -> np.ndarray:
    """(3, BINS) per bin: pixels, summed probability, summed truth. Both inputs are 0..1 and of one shape.

    Pixels below `floor` are left out: nearly every pixel of an image is certain background, which would hide the rest. The
    choice looks at the prediction alone, so that it does not bend the curve.
    """
    chosen = probability >= floor
    p, t = probability[chosen].astype(np.float64), truth[chosen].astype(np.float64)
    bins = np.minimum((p * BINS).astype(np.int64), BINS - 1)
    return np.stack([np.bincount(bins, weights, BINS) for weights in (np.ones_like(p), p, t)])


def expected_error(table: np.ndarray) -> float:
    """Expected calibration error of a (3, b) table (Guo et al. 2017): the mean gap, weighted by pixels. NaN without any."""
    count, probability, truth = table
    total = count.sum()
    return float(np.abs(probability - truth).sum() / total) if total else float("nan")
