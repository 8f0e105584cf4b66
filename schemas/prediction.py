"""What a two-hand affordance model says about one image and one task."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from schemas.hands import SIDES
from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Prediction(Schema):
    """Where each hand goes: k plausible regions per hand, how likely each is, and which hands the task takes."""

    task: str = value("what is to be done: 'pour tea from kettle'")
    probability: np.ndarray = array("2 k h w", "float32", "hand (left, right), hypothesis; 0..1, at the image's own size")
    score: np.ndarray = array("2 k", "float32", "probability that this hypothesis is the one; each row sums to 1")
    taxonomy: np.ndarray = array("4", "float32", "probabilities of left, right, both_same, both_different; their sum is 1")
    hands: np.ndarray = array("2", "bool", "which hands (left, right) are returned after selection")
    threshold: float = value("a pixel belongs to the region where its probability is above this")

    def mask(self, side: int | str) -> np.ndarray:
        """(h, w) bool: the top-ranked region of a hand (0 or 'left', 1 or 'right'), empty when that hand is not selected."""
        hand = SIDES.index(side) if isinstance(side, str) else side
        found: np.ndarray = self.probability[hand, self.score[hand].argmax()] > self.threshold
        return found & self.hands[hand]
