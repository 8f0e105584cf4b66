"""Calibration of the hand finder: a logistic line from its log odds to those of a hand, fitted on validation pictures."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import torch
from torch import nn

from afford.extraction.hands.model import HAND
from afford.extraction.hands.network import Calibration

PIXELS = 4000
"""pixels of a batch that the fit reads"""
LOGIT_LIMIT = 30.0


def calibrate(model: nn.Module, batches: Iterable[tuple[torch.Tensor, np.ndarray]], seed: int) -> Calibration:
    """Fit scale and bias on batches of pictures (b, 3, h, w), RGB 0..1, and masks (b, h, w) bool of hands.

    The scale is at most 1: validation pictures come from the renderer of the training, so they give no reason for more certainty.
    """
    rng, odds, truth = np.random.default_rng([seed, 3]), [], []
    model.eval()
    with torch.inference_mode():
        for pictures, hands in batches:
            found = model(pictures)[:, HAND].numpy().ravel()
            chosen = rng.choice(found.size, min(PIXELS, found.size), replace=False)
            odds.append(found[chosen])
            truth.append(hands.ravel()[chosen])
    (scale,), bias = fit_logistic(np.concatenate(odds)[:, None], np.concatenate(truth))
    return Calibration(float(np.clip(scale, 0.05, 1.0)), float(np.clip(bias, -5, 5)))


def fit_logistic(features: np.ndarray, truth: np.ndarray, prior: float = 1e-3) -> tuple[tuple[float, ...], float]:
    """Fit weights and bias of a logistic model by Newton's method, with a Gaussian prior on the weights.

    features: (n, k); truth: (n,) bool.
    """
    x, y = np.c_[features, np.ones(len(features))].astype(np.float64), np.asarray(truth, np.float64)
    keep = np.r_[np.full(features.shape[1], prior * len(x)), 1e-6]
    found = np.zeros(x.shape[1])
    for _ in range(50):
        p = 1 / (1 + np.exp(-np.clip(x @ found, -LOGIT_LIMIT, LOGIT_LIMIT)))
        curvature = x.T @ (x * (p * (1 - p) + 1e-9)[:, None]) + np.diag(keep)
        found -= np.clip(np.linalg.solve(curvature, x.T @ (p - y) + keep * found), -2, 2)
    return tuple(float(v) for v in found[:-1]), float(found[-1])
