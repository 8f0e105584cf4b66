"""Narration intervals -> labels of the frames that exist."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np

from afford.extraction.labels.overlap import Pairs
from schemas.affordance import FrameLabels
from schemas.video import Clip, Narration


def label_frames(
    clip: Clip, frame: np.ndarray, excluded: Collection[str], choose: Callable[[np.ndarray, Sequence[Narration]], Pairs]
) -> FrameLabels:
    """Labels of the frames `frame` (t,) int64. Narrations whose verb is `excluded` (the word as narrated, or the key of its
    class, exactly) are put aside before `choose` settles overlaps.
    """
    kept = [n for n in clip.narrations if not {n.verb, n.verb_key} & set(excluded)]
    start, stop = np.array([(n.start_frame, n.stop_frame) for n in kept], np.int64).reshape(-1, 2).T
    covers = (frame[:, None] >= start) & (frame[:, None] <= stop)
    at, number = choose(covers, kept)
    used, index = np.unique(number, return_inverse=True)
    silent = [n.narration_id for n, column in zip(kept, covers.T, strict=True) if not column.any()]
    return FrameLabels(
        clip_id=clip.clip_id, narrations=tuple(kept[k] for k in used), frame=frame[at].astype(np.int64),
        narration=index.astype(np.int32), unmatched=tuple(silent),
        excluded=tuple(n.narration_id for n in clip.narrations if n not in kept))
