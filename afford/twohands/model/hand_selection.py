"""Selection of the hands that a prediction returns, by the taxonomy head or by the caller (2HandedAfforder, section 4)."""

from __future__ import annotations

import numpy as np

from schemas.affordance import TAKES

HANDS = ("auto", "left", "right", "both")
"""auto: by the taxonomy; left, right, both: forced. `both` is also the ablation without selection"""


def select_hands(taxonomy: np.ndarray, hands: str = "auto") -> np.ndarray:
    """Select hands from taxonomy probabilities (4,): (2,) bool (left, right), by the most probable class when `hands` is auto.

    ValueError when `hands` is not in HANDS.
    """
    if hands not in HANDS:
        raise ValueError(f"hands: expected one of {', '.join(HANDS)}, got {hands!r}")
    if hands == "auto":
        return np.array(TAKES[int(taxonomy.argmax())])
    return np.array([hands != "right", hands != "left"])


def hand_probabilities(taxonomy: np.ndarray) -> np.ndarray:
    """Probability (2,) float32 that the (left, right) hand takes part, from the probabilities (4,) of the classes."""
    return np.asarray(taxonomy @ np.array(TAKES, np.float32), np.float32)
