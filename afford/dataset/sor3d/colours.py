"""Labels as the colours of mask pictures, and back. A mask shows one class; every other colour is background."""

from __future__ import annotations

import numpy as np

from schemas.interaction import AFFORDANCES, BACKGROUND, COLOURS_BGR


def paint(label: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8 BGR picture of a label (h, w) uint8; background is black. ValueError for a label that is none."""
    table = np.array([*(COLOURS_BGR[name] for name in AFFORDANCES), (0, 0, 0)], np.uint8)
    if label.max(initial=0) > BACKGROUND:
        raise ValueError(f"label: expected 0 to {BACKGROUND}, got {int(label.max())}")
    return np.asarray(table[label])


def commonest(picture: np.ndarray) -> tuple[int, int, int] | None:
    """The colour, blue, green, red, that most pixels of the picture (h, w, 3) BGR have, black apart; None when all are black."""
    found, count = np.unique(picture.reshape(-1, 3), axis=0, return_counts=True)
    count[(found == 0).all(axis=-1)] = 0
    return tuple(found[count.argmax()].tolist()) if count.any() else None


def unpaint(picture: np.ndarray, affordance: str) -> np.ndarray:
    """(h, w) uint8: index of the affordance where the picture (h, w, 3) BGR has exactly its colour, BACKGROUND elsewhere."""
    hit = (picture == np.array(COLOURS_BGR[affordance], np.uint8)).all(axis=-1)
    return np.where(hit, np.uint8(AFFORDANCES.index(affordance)), np.uint8(BACKGROUND))
