"""Calibration of a model, so that a probability is the share of such pixels that people touch.

A model that learns by cross-entropy and Dice is far too sure of itself. The temperature of its taxonomy, then slope and offset of
the logits of its regions, are fitted on validation pictures (Platt 1999 with his prior, Guo et al. 2017). The order of pixels and
of classes, and so every region, stays as it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from scipy.optimize import minimize, minimize_scalar
from scipy.special import expit, logit, softmax

Calibration = tuple[float, float]
"""slope and offset of logits"""
IDENTITY: Calibration = (1.0, 0.0)
LARGEST, BINS = 12.0, 480
"""largest absolute logit that differs from larger ones, and bins of logits between both ends"""
TEMPERATURES, CERTAIN = (0.5, 10.0), 1e-6
"""temperatures that a taxonomy may have, and distance of a hand's probability from 0 and 1"""


def calibrated(probability: float, calibration: Calibration) -> float:
    """Map a probability of the model itself, 0..1, to the calibrated one."""
    if calibration == IDENTITY or probability in (0.0, 1.0):
        return probability
    slope, offset = calibration
    return 1.0 / (1.0 + math.exp(-slope * math.log(probability / (1.0 - probability)) - offset))


def tempered(taxonomy: np.ndarray, temperature: float) -> np.ndarray:
    """Divide the logits of taxonomy probabilities (..., 4) by a temperature; float32, with sums of 1."""
    logits = np.log(np.clip(taxonomy.astype(np.float64), np.finfo(np.float32).tiny, 1.0))
    return np.asarray(softmax(logits / temperature, -1), np.float32)


def fit_temperature(taxonomy: np.ndarray, labels: np.ndarray) -> float:
    """Fit the temperature of taxonomy probabilities (n, 4) to labels (n,) by maximum likelihood.

    It is in `TEMPERATURES`; 1 without labels.
    """
    if not len(labels):
        return 1.0
    right = np.arange(len(labels)), labels

    def cost(temperature: float) -> float:
        return -float(np.log(np.maximum(tempered(taxonomy, temperature)[right], CERTAIN)).mean())

    return round(float(minimize_scalar(cost, bounds=TEMPERATURES, method="bounded").x), 4)


def fit_calibration(regions: Iterable[tuple[np.ndarray, np.ndarray, float]]) -> Calibration:
    """Fit slope and offset of logits by maximum likelihood.

    regions: probabilities (n,) float32 of the pixels of a hand's region, truth (n,) bool, and the calibrated probability that the
    hand takes part, by which those of its pixels are multiplied. `IDENTITY` where truth is all one class, or where the fitted slope
    is not above 0, so that no order of pixels is turned around.
    """
    counted = [(_counts(probability, truth), hand) for probability, truth, hand in regions]
    table = np.stack([np.zeros((2, BINS)), *(counts for counts, _ in counted)])
    hand = np.clip([1.0, *(share for _, share in counted)], CERTAIN, 1.0 - CERTAIN)[:, None]
    missed, touched = table[:, 0], table[:, 1]
    if not missed.any() or not touched.any():
        return IDENTITY
    centre = (np.arange(BINS) + 0.5) * (2 * LARGEST / BINS) - LARGEST
    prior = (1 / (missed.sum() + 2), (touched.sum() + 1) / (touched.sum() + 2))  # of both classes; keeps a perfect fit finite
    truth = missed * prior[0] + touched * prior[1]
    idle, count = missed + touched - truth, table.sum()

    def cost(at: np.ndarray) -> tuple[float, np.ndarray]:
        z = at[0] * centre + at[1]
        region = expit(z)
        loss = -(truth * (np.log(hand) - np.logaddexp(0, -z)) + idle * np.log1p(-hand * region)).sum()
        slope = ((idle * hand * region / (1 - hand * region) - truth) * (1 - region)).sum(0)
        return float(loss / count), np.array([slope @ centre, slope.sum()]) / count

    slope, offset = (round(float(value), 4) for value in minimize(cost, np.array(IDENTITY), jac=True, method="BFGS").x)
    return (slope, offset) if slope > 0 else IDENTITY


def _counts(probability: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Pixels (2, BINS) that people did not and did touch, by the logit of the model."""
    least = 1.0 / (1.0 + math.exp(LARGEST))
    at = logit(np.clip(probability.astype(np.float64), least, 1.0 - least))
    bins = np.clip(((at + LARGEST) * (BINS / (2 * LARGEST))).astype(np.int64), 0, BINS - 1)
    return np.stack([np.bincount(bins[truth == one], minlength=BINS) for one in (False, True)]).astype(np.float64)
