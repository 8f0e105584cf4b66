"""Which narrations label which frames, when several speak of one."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from schemas.video import Narration

Pairs = tuple[np.ndarray, np.ndarray]
"""positions among the frames (m,) and narration numbers (m,), by frame and then by narration"""


def every(covers: np.ndarray, narrations: Sequence[Narration]) -> Pairs:
    """All narrations of each frame. covers: (t, k) bool, whether narration k speaks of frame t."""
    at, number = np.nonzero(covers)
    return at, number


def last(covers: np.ndarray, narrations: Sequence[Narration]) -> Pairs:
    """The narration that comes last in the file, as in the released code of 2HandedAfforder."""
    return _first(covers, range(len(narrations) - 1, -1, -1))


def shortest(covers: np.ndarray, narrations: Sequence[Narration]) -> Pairs:
    """The narration with the shortest interval: the most specific one; the later one of equals."""
    lengths = [n.stop_frame - n.start_frame for n in narrations]
    return _first(covers, sorted(range(len(narrations)), key=lambda k: (lengths[k], -k)))


def _first(covers: np.ndarray, order: Sequence[int]) -> Pairs:
    """For each covered frame the narration that comes first in `order`."""
    ranked = covers[:, list(order)]
    at = np.flatnonzero(ranked.any(axis=1))
    return at, np.array(order, np.int64)[ranked[at].argmax(axis=1)] if len(at) else np.zeros(0, np.int64)

