"""Platt scaling of the regions of a model, so that a probability is the share of such pixels that people touch.

A model that learns by cross-entropy and Dice is far too sure of itself. Slope and offset of its logits are fitted on validation
pictures (Platt 1999 with his prior, Guo et al. 2017); the order of pixels, and so every region, stays as it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit

Calibration = tuple[float, float]
"""slope and offset of logits"""
IDENTITY: Calibration = (1.0, 0.0)
LARGEST, BINS = 12.0, 480
"""largest absolute logit that differs from larger ones, and bins of logits between both ends"""


def calibrated(probability: float, calibration: Calibration) -> float:
    """Map a probability of the model itself, 0..1, to the calibrated one."""
    if calibration == IDENTITY or probability in (0.0, 1.0):
        return probability
    slope, offset = calibration
    return 1.0 / (1.0 + math.exp(-slope * math.log(probability / (1.0 - probability)) - offset))


def fit_calibration(regions: Iterable[tuple[np.ndarray, np.ndarray]]) -> Calibration:
    """Fit slope and offset to pairs of probabilities (n,) float32 and truth (n,) bool by maximum likelihood.

    `IDENTITY` where truth is all one class, or where the fitted slope is not above 0, so that no order of pixels is turned around.
    """
    table = np.sum([np.zeros((2, BINS)), *(_counts(*pair) for pair in regions)], axis=0)
    missed, touched = table
    if not missed.any() or not touched.any():
        return IDENTITY
    centre = (np.arange(BINS) + 0.5) * (2 * LARGEST / BINS) - LARGEST
    prior = (1 / (missed.sum() + 2), (touched.sum() + 1) / (touched.sum() + 2))  # of both classes; keeps a perfect fit finite
    count, truth = missed + touched, missed * prior[0] + touched * prior[1]

    def cost(at: np.ndarray) -> tuple[float, np.ndarray]:
        z = at[0] * centre + at[1]
        error = count * expit(z) - truth
        return float((count * np.logaddexp(0, z) - truth * z).sum() / count.sum()), np.array(
            [error @ centre, error.sum()]) / count.sum()

    slope, offset = (round(float(value), 4) for value in minimize(cost, np.array(IDENTITY), jac=True, method="BFGS").x)
    return (slope, offset) if slope > 0 else IDENTITY


def _counts(probability: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Pixels (2, BINS) that people did not and did touch, by the logit of the model."""
    least = 1.0 / (1.0 + math.exp(LARGEST))
    at = logit(np.clip(probability.astype(np.float64), least, 1.0 - least))
    bins = np.clip(((at + LARGEST) * (BINS / (2 * LARGEST))).astype(np.int64), 0, BINS - 1)
    return np.stack([np.bincount(bins[truth == one], minlength=BINS) for one in (False, True)]).astype(np.float64)
