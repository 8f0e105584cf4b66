"""SAM 3 is asked in words: a hand, the left one, the right one, what is held, a sleeve."""

from __future__ import annotations

import numpy as np

from afford.extraction.hands import Sam3
from afford.models.sam3 import concept_probabilities, load_model
from afford.models.weights import with_local_weights
from schemas.files import FileTree

WEIGHTS = "a Sam3Model with its tokenizer.json: folder of save_pretrained, or hub id as facebook/sam3"
PHRASES = ("hand", "left hand", "right hand", "object held in a hand", "sleeve")
DOUBT = 0.05
"""added to both sides: a hand that is neither the left one nor the right one in words is half of each"""


def find(rgb: np.ndarray, params: Sam3, weights: FileTree | None = None) -> np.ndarray:
    """See `Find`."""
    model = load_model(with_local_weights(params, weights).model, params.device, params.dtype)
    hand, left, right, thing, sleeve = concept_probabilities(model, rgb, PHRASES, params.threshold)
    any_hand = np.maximum(hand, np.maximum(left, right))
    share, none = (left + DOUBT) / (left + right + 2 * DOUBT), 1 - any_hand
    return np.stack([any_hand * share, any_hand * (1 - share), thing * none, sleeve * none], -1).astype(np.float32)
