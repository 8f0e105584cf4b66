"""Frame labels from narrations, and the policies for frames that several narrations cover."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np

from schemas.affordance import FrameLabels
from schemas.video import Clip, Narration

Pairs = tuple[np.ndarray, np.ndarray]
"""positions among the frames (m,) and narration numbers (m,), by frame and then by narration"""


def all_narrations(covers: np.ndarray, narrations: Sequence[Narration]) -> Pairs:
    """Keep all narrations of each frame. covers: (t, k) bool, narration k covers frame t."""
    at, number = np.nonzero(covers)
    return at, number


def last(covers: np.ndarray, narrations: Sequence[Narration]) -> Pairs:
    """Choose the narration that comes last in the file, as in the released code of 2HandedAfforder."""
    return _first_in_order(covers, range(len(narrations) - 1, -1, -1))


def shortest(covers: np.ndarray, narrations: Sequence[Narration]) -> Pairs:
    """Choose the narration with the shortest interval, the most specific one; the later on a tie."""
    lengths = [n.stop_frame - n.start_frame for n in narrations]
    return _first_in_order(covers, sorted(range(len(narrations)), key=lambda k: (lengths[k], -k)))


def _first_in_order(covers: np.ndarray, order: Sequence[int]) -> Pairs:
    """Choose, for each covered frame, the narration that comes first in `order`."""
    ranked = covers[:, list(order)]
    at = np.flatnonzero(ranked.any(axis=1))
    return at, np.array(order, np.int64)[ranked[at].argmax(axis=1)] if len(at) else np.zeros(0, np.int64)


def label_frames(
    clip: Clip, frame: np.ndarray, excluded: Collection[str], choose: Callable[[np.ndarray, Sequence[Narration]], Pairs]
) -> FrameLabels:
    """Label the frames `frame` (t,) int64 with the narrations that cover them.

    Narrations whose verb is `excluded` (the word as narrated, or the key of its class, exactly) are removed before `choose`
    resolves overlaps.
    """
    kept = [n for n in clip.narrations if not {n.verb, n.verb_key} & set(excluded)]
    start, stop = np.array([(n.start_frame, n.stop_frame) for n in kept], np.int64).reshape(-1, 2).T
    covers = (frame[:, None] >= start) & (frame[:, None] <= stop)
    at, number = choose(covers, kept)
    used, index = np.unique(number, return_inverse=True)
    unmatched = [n.narration_id for n, column in zip(kept, covers.T, strict=True) if not column.any()]
    return FrameLabels(
        clip_id=clip.clip_id, narrations=tuple(kept[k] for k in used), frame=frame[at].astype(np.int64),
        narration=index.astype(np.int32), unmatched=tuple(unmatched),
        excluded=tuple(n.narration_id for n in clip.narrations if n not in kept))
