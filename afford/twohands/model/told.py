"""What a model says of one picture, before anything is chosen of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from torch import Tensor


class Told(NamedTuple):
    """What a model says of one picture."""

    probability: np.ndarray
    """(2, k, h, w) float32 at the picture's own size"""
    score: Tensor
    """(2, k) logits"""
    taxonomy: np.ndarray
    """(4,) float32 probabilities"""
    objects: Tensor | None
    """(2, h', w') logits of the complete objects, over the whole letter-box; None where the model does not tell them"""


def agreed_taxonomy(one: Told, other: Told) -> np.ndarray:
    """(4,) the geometric mean of both, which sums to 1."""
    both = np.sqrt(one.taxonomy * other.taxonomy)
    return np.asarray(both / max(both.sum(), np.finfo(np.float32).tiny))
