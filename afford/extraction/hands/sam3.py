"""Find hands, held objects and sleeves with SAM 3, prompted with noun phrases."""

from __future__ import annotations

import numpy as np

from afford.extraction.hands import Sam3
from afford.models.sam3 import concept_probabilities, load_model
from afford.models.weights import with_local_weights
from schemas.files import FileTree

WEIGHTS = "a Sam3Model with its tokenizer.json: folder of save_pretrained, or hub id as facebook/sam3"
MET = "authors' package, random weights, 2026-11: names and shapes of the detector in sam3 0.1.4; masks with tiny ones"
PHRASES = ("hand", "left hand", "right hand", "object held in a hand", "sleeve")
SMOOTHING = 0.05
"""added to both sides, so that a hand without a detected side counts half for each"""


def find(rgb: np.ndarray, params: Sam3, weights: FileTree | None = None) -> np.ndarray:
    """Find hands with SAM 3, see `Find`."""
    model = load_model(with_local_weights(params, weights).model, params.device, params.dtype)
    hand, left, right, thing, sleeve = concept_probabilities(model, rgb, PHRASES, params.threshold)
    any_hand = np.maximum(hand, np.maximum(left, right))
    share, no_hand = (left + SMOOTHING) / (left + right + 2 * SMOOTHING), 1 - any_hand
    return np.stack([any_hand * share, any_hand * (1 - share), thing * no_hand, sleeve * no_hand], -1).astype(np.float32)
