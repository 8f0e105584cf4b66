"""SAM 2 on a video of two frames, as 2HandedAfforder has it: the frame, prompted by the visible mask, and the frame without hands.

What is found in the second is the complete object.
"""

from __future__ import annotations

import numpy as np

from afford.extraction.complete import Completed, Sam2
from afford.models.sam2 import load_model, track
from schemas.masks import Tracks
from schemas.video import Frames, Inpainted

WEIGHTS = "a Sam2VideoModel: folder of save_pretrained, sam2*_hiera_*.pt, or hub id as facebook/sam2.1-hiera-tiny"


def complete(frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: Sam2) -> Completed:
    """See `Complete`. Frames in which the object is out of sight stay empty; confidence is the mean probability inside."""
    model = load_model(params.model, params.device, params.dtype)
    visible = tracks.masks[index]
    masks = np.zeros_like(visible)
    confidence = np.zeros(len(visible), np.float32)
    for t in np.flatnonzero(visible.any(axis=(1, 2))):
        pair = np.stack([frames.rgb[t], inpainted.rgb[t]])
        logits = track(model, pair, {0: visible[t][None]})[0, 1]
        masks[t] = logits > 0
        confidence[t] = (1 / (1 + np.exp(-logits[masks[t]]))).mean() if masks[t].any() else 0.0
    return Completed(masks, confidence)
