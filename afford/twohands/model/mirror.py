"""A picture and its mirror image: a model is asked about both, and what it says of each is averaged.

Its K regions of the two need not come in one order, so that each is averaged with the one that overlaps it most.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment
from torch import from_numpy

from afford.twohands.model.told import Told, agreed_taxonomy
from schemas.affordance import MIRRORED


def mirrored(image: np.ndarray) -> np.ndarray:
    """(h, w, ...) in a mirror."""
    return np.ascontiguousarray(image[:, ::-1])


def agreed(told: Told, in_mirror: Told) -> Told:
    """Both opinions in one: regions and scores averaged (of the logarithms), the objects those of the picture itself."""
    back = Told(in_mirror.probability[::-1, :, :, ::-1], in_mirror.score.flip(0), in_mirror.taxonomy[list(MIRRORED)], None)
    order = _order(told.probability, back.probability)
    regions = (told.probability + back.probability[:, order]) / 2
    score = (told.score.log_softmax(-1) + back.score[:, from_numpy(order)].log_softmax(-1)) / 2
    return Told(regions, score, agreed_taxonomy(told, back), told.objects)


def _order(regions: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(k,) of the other regions, one order for both hands, so that each overlaps its counterpart most (soft Dice)."""
    a, b = (r.reshape(*r.shape[:2], -1) for r in (regions, others))
    shared, total = a @ b.swapaxes(1, 2), a.sum(-1)[:, :, None] + b.sum(-1)[:, None]
    dice = (2 * shared / np.maximum(total, np.finfo(np.float32).tiny)).sum(0)
    return np.asarray(linear_sum_assignment(dice, maximize=True)[1])
