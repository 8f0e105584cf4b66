"""Which hands a prediction returns: the taxonomy head says, or the caller does (2HandedAfforder, test-time selection)."""

from __future__ import annotations

import numpy as np

from schemas.affordance import TAKES

HANDS = ("auto", "left", "right", "both")
"""auto: by the taxonomy; left, right, both: forced. `both` is also the ablation without selection."""


def select_hands(taxonomy: np.ndarray, hands: str = "auto") -> np.ndarray:
    """(2,) bool (left, right) from taxonomy probabilities (4,): the likeliest class decides when `hands` is auto.

    ValueError when `hands` is none of HANDS.
    """
    if hands not in HANDS:
        raise ValueError(f"hands: expected one of {', '.join(HANDS)}, got {hands!r}")
    if hands == "auto":
        return np.array(TAKES[int(taxonomy.argmax())])
    return np.array([hands != "right", hands != "left"])


def taking(taxonomy: np.ndarray) -> np.ndarray:
    """(2,) float32: probability that the (left, right) hand takes part, from those of the four classes."""
    return np.asarray(taxonomy @ np.array(TAKES, np.float32), np.float32)


def three_way(taxonomy: np.ndarray) -> np.ndarray:
    """(..., 4) probabilities -> (..., 3): one hand, both on one object, both on different ones (docs/conventions.md)."""
    return np.concatenate([taxonomy[..., :2].sum(-1, keepdims=True), taxonomy[..., 2:]], axis=-1)
