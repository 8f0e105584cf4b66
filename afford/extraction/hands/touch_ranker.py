"""Score of a candidate for what a hand touches: logistic regression over its features, fitted by benchmarks/hands/fit_touch.py."""

from __future__ import annotations

import numpy as np

from afford.extraction.hands.touch_candidates import FEATURES

WEIGHTS = {
    "quality": 1.593, "stable": 0.570, "size": 0.432, "size squared": -0.103, "picture border": -6.189, "hand inside hull": -0.996,
    "ring covered": 1.947, "unexplained": 1.881, "along": 0.883, "agreement": 2.293, "distance": -0.535, "far": -1.668,
}  # fmt: skip
BIAS = -5.017


def touch_scores(features: np.ndarray) -> np.ndarray:
    """Compute the log odds (n,) float64 that each candidate (n, len(FEATURES)) is the touched object; 0 means even."""
    return np.asarray(features.astype(np.float64) @ np.array([WEIGHTS[name] for name in FEATURES]) + BIAS)
