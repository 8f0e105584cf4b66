"""Places where a classifier is made to be sure of the things that a task names.

On photographs the image encoder's classifier is often sure of a thing in a whole picture, on rendered stills seldom. A model that
learns from stills alone therefore makes little of a sure classifier. Its scores rise here around a part of each thing, as class
activation maps of photographs do, and now and then at a wrong place.
"""

from __future__ import annotations

import numpy as np

from afford.dataset.load import Item
from afford.twohands.model.class_words import THINGS, named_classes

GAIN = (2.0, 16.0)
"""range of what is added to a score; on photographs, scores at a thing are about 14 above those elsewhere"""
REACH = (0.3, 1.2)
"""range of the reach around the chosen part, in square roots of the area of the thing"""
ASTRAY = 0.15
"""share of things that are seen at a wrong place"""


def sure_places(item: Item, rng: np.random.Generator) -> np.ndarray | None:
    """Gains on the scores of each thing of a task, (THINGS, h, w) float32; None where none of them is in the picture."""
    sides = {side: set(named_classes(name)) for side, name in ((2, item.object_left), (3, item.object_right))}
    height, width = item.masks.shape[1:]
    planes, found = np.zeros((THINGS, height, width), np.float32), False
    for plane, thing in zip(planes, named_classes(item.narration), strict=False):
        mask = np.asarray(item.masks[[side for side, things in sides.items() if thing in things]].any(0))
        if mask.any():
            plane[:], found = _seen(mask, rng), True
    return planes if found else None


def _seen(mask: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Gain (h, w) around a random part of a mask, or around a random place."""
    rows, columns = np.nonzero(mask)
    one = int(rng.integers(len(rows)))
    centre, gain, reach = (rows[one], columns[one]), rng.uniform(*GAIN), rng.uniform(*REACH) * np.sqrt(len(rows))
    astray = rng.random() < ASTRAY
    if astray:
        centre = tuple(rng.integers(mask.shape))
    y, x = (np.arange(side) - at for side, at in zip(mask.shape, centre, strict=True))
    bump = np.exp(-(y[:, None] ** 2 + x[None] ** 2) / (2 * reach**2))
    inside = 1.0 if astray else mask
    return np.asarray(gain * bump * inside, np.float32)
