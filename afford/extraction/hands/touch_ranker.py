"""Score of a candidate for what a hand touches: logistic regression over its features.

The weights were fitted once on 457 hands of development clips, by the method of benchmarks/hands/fit_touch.py (decision 044).
"""

from __future__ import annotations

import numpy as np

from afford.extraction.hands.touch_candidates import FEATURES

WEIGHTS = {
    "quality": 1.353, "stable": 0.321, "size": 0.378, "size squared": -0.106, "picture border": -5.546, "hand inside hull": -0.987,
    "ring covered": 1.371, "unexplained": 1.949, "along": 0.861, "agreement": 3.040, "distance": -0.420, "far": -1.633,
}  # fmt: skip
BIAS = -4.834


def touch_scores(features: np.ndarray) -> np.ndarray:
    """Compute the log odds (n,) float64 that each candidate (n, len(FEATURES)) is the touched object; 0 means even."""
    return np.asarray(features.astype(np.float64) @ np.array([WEIGHTS[name] for name in FEATURES]) + BIAS)
