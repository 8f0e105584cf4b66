"""Completion by SAM 2, as 2HandedAfforder does it: a two-frame video, the frame and the same frame without hands.

The visible mask prompts the first; what is found in the second is the complete object. Reads `params.model`: a local folder
or hub id of a `Sam2VideoModel`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from afford.backends.complete import Completed
from afford.models.sam2_video import load_model, track
from schemas.masks import Tracks
from schemas.video import Frames, Inpainted


def complete(frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: Any) -> Completed:
    """See `Complete`. Frames in which the object is out of sight stay empty; confidence is the mean probability inside."""
    model = load_model(params.model)
    visible = tracks.masks[index]
    masks = np.zeros_like(visible)
    confidence = np.zeros(len(visible), np.float32)
    for t in np.flatnonzero(visible.any(axis=(1, 2))):
        pair = np.stack([frames.rgb[t], inpainted.rgb[t]])
        logits = track(model, pair, {0: visible[t][None]})[0, 1]
        masks[t] = logits > 0
        confidence[t] = (1 / (1 + np.exp(-logits[masks[t]]))).mean() if masks[t].any() else 0.0
    return Completed(masks, confidence)
