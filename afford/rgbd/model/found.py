"""What a model of sequences says of one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.interaction import AFFORDANCES, BACKGROUND

CONFIDENT = 0.75
"""probability above which the paper shows a region"""


@dataclass(frozen=True)
class Found:
    """What a model says of the last frame of a sequence, at the size of its input."""

    probability: np.ndarray
    """(10, h, w) float32 by AFFORDANCES and, last, BACKGROUND; sums to 1 over the first axis"""
    action: np.ndarray
    """(9,) float32 by AFFORDANCES, sums to 1"""
    attention: np.ndarray
    """(h', w') float32 over the latent, sums to 1; (0, 0) without attention"""

    @property
    def label(self) -> np.ndarray:
        """(h, w) uint8: the likeliest class."""
        return self.probability.argmax(0).astype(np.uint8)

    def confident(self, threshold: float = CONFIDENT) -> np.ndarray:
        """(h, w) uint8: the affordance whose probability is above `threshold`, BACKGROUND elsewhere."""
        best = self.probability[:BACKGROUND]
        return np.where(best.max(0) > threshold, best.argmax(0), BACKGROUND).astype(np.uint8)


def likeliest(action: np.ndarray) -> str:
    """The name of the likeliest action."""
    return AFFORDANCES[int(action.argmax())]
