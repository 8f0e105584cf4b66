"""A second look: where the thing fills little of a picture, the model is asked again about the crop around it.

Most of what a model from nothing learns are crops, in which a handle is more than a few pixels; in a whole picture it finds the
thing, but hardly its parts. Where the thing stands, and so which hand is nearer, only the whole picture tells: both looks vote.
"""

from __future__ import annotations

import cv2
import numpy as np

from afford.common.masks import BORDER, Box, box
from afford.twohands.model.letterbox import content_size
from afford.twohands.model.select import taking
from afford.twohands.model.told import Told, agreed_taxonomy

FILLED = 0.2
"""share of the picture from which the box of the thing is close enough: crops are not cropped again"""
IDLE = 0.3
"""a hand that acts with less probability is not asked what it takes"""
SPECK = 0.2
"""parts of the object smaller than this share of its largest one are not the object"""


def window(told: Told, size_px: tuple[int, int]) -> Box | None:
    """Where to look again: the box of the object with ActAffordance's border; None when the first look was close enough, or
    nothing was found that is seen at the picture's own size.
    """
    if told.objects is None:
        return None
    height, width = told.probability.shape[2:]
    found = _object(told, content_size(height, width, size_px), size_px)
    if not found.any():
        return None
    large = cv2.resize(found.view(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST).view(bool)
    if not large.any():  # a picture of a few pixels
        return None
    rows, columns = box(large)
    filled = (rows.stop - rows.start) * (columns.stop - columns.start) / (height * width)
    return None if filled > FILLED else box(large, round(BORDER * max(height, width)))


def joined(first: Told, closer: Told, at: Box) -> Told:
    """Regions of the second look in the first one's picture, nothing outside; the taxonomies' geometric mean."""
    probability = np.zeros((*closer.probability.shape[:2], *first.probability.shape[2:]), np.float32)
    probability[:, :, at[0], at[1]] = closer.probability
    return Told(probability, closer.score, agreed_taxonomy(first, closer), closer.objects)


def _object(told: Told, inner: tuple[int, int], size_px: tuple[int, int]) -> np.ndarray:
    """(h', w') bool: the objects of the hands that act, without specks and without what lies in the padding."""
    assert told.objects is not None
    acts = taking(told.taxonomy) > IDLE
    found = np.asarray(((told.objects > 0).cpu().numpy() & acts[:, None, None]).any(axis=0))
    rows, columns = (-(-side * shown // whole) for side, shown, whole in zip(inner, found.shape, size_px, strict=True))
    found = found[:rows, :columns]
    _, label, stats, _ = cv2.connectedComponentsWithStats(np.ascontiguousarray(found).view(np.uint8))
    area = np.where(np.arange(len(stats)) > 0, stats[:, cv2.CC_STAT_AREA], 0)
    enough = np.asarray(area >= max(SPECK * area.max(), 1))
    return enough[label]
