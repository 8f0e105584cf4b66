"""Threshold of one prediction: the regions whose expected IoU with what people touch is largest.

Where a model is sure, few pixels are uncertain and the threshold hardly matters. Where it is not, as with kinds that training did
not show, every pixel has a low probability, and one threshold for all pictures cuts off most of the region. The best threshold for
a picture follows from its calibrated probabilities (Lipton et al. 2014, for F1).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.special import expit, logit

TRUST = 0.9
"""factor of the logits: errors of neighbouring pixels go together, so that a region is less certain than independent pixels are.
1 gives smaller regions, which are a little more precise and miss more of kinds that training did not show"""
LEAST = 0.02
"""smallest threshold: below it a pixel is never part of a region, so that a picture without an object keeps empty regions"""
LIMIT, SIDE_PX = 1e-5, 160
"""distance of probabilities from 0 and 1, and height and width of a picture above which rows and columns are left out"""


class RegionCut(NamedTuple):
    """Threshold of a prediction, and what is expected of its regions."""

    threshold: float
    """`LEAST` or more"""
    expected_iou: float
    """expected IoU with what people touch, 0..1"""


def region_cut(probability: np.ndarray) -> RegionCut:
    """Compute the threshold of calibrated probabilities (n, h, w) of the regions of the n hands that act."""
    down, across = (-(-side // SIDE_PX) for side in probability.shape[1:])
    likely = np.sort(probability[:, ::down, ::across], axis=None)[::-1]
    weight = expit(TRUST * logit(np.clip(likely.astype(np.float64), LIMIT, 1 - LIMIT)))
    touched, count = weight.cumsum(), np.arange(1, likely.size + 1)
    expected_iou = touched / (count + touched[-1] - touched)
    best = int(expected_iou.argmax())
    threshold = float(np.nextafter(np.float32(likely[best]), np.float32(0)))
    return RegionCut(max(threshold, LEAST), float(expected_iou[best]))
