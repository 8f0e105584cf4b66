"""Complete objects with SAM 2 on a video of two frames, as in 2HandedAfforder.

The first frame is the original, prompted with the visible mask; the second is the frame without hands. The mask of the second frame
is the complete object.
"""

from __future__ import annotations

import numpy as np

from afford.extraction.complete import Completed, Sam2
from afford.models.sam2 import load_model, track
from schemas.masks import Tracks
from schemas.video import Frames, Inpainted

WEIGHTS = "a Sam2VideoModel: folder of save_pretrained, sam2*_hiera_*.pt, or hub id as facebook/sam2.1-hiera-tiny"
MET = "tiny random weights, 2026-11: two frames, as mask_densify loads it"


def complete(frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: Sam2) -> Completed:
    """Complete with SAM 2, see `Complete`.

    Frames in which the object is invisible stay empty. Confidence is the mean probability inside the mask.
    """
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
