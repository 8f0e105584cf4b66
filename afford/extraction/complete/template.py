"""The object's shape as other frames saw it, laid over this frame by the object's own motion."""

from __future__ import annotations

import cv2
import numpy as np

from afford.common.masks import dilate
from afford.extraction.complete import Completed
from afford.extraction.layers import regions
from afford.extraction.layers.carry import carry, holding
from afford.extraction.layers.follow import follow
from afford.extraction.layers.shape import complete_shape
from schemas.masks import Tracks
from schemas.video import Frames, Inpainted


def complete(frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: None) -> Completed:
    """Follow the object, carry it with the hand while hardly any of it shows, then let all frames vote on its hidden pixels.

    What no frame has seen is guessed behind hands only: things that touch each other seldom hide much.
    """
    grey = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in frames.rgb])
    visible, hidden_by = tracks.masks[index], dilate(regions.others(tracks, index), 1)
    path = carry(follow(grey, visible, hidden_by), grey, visible, holding(tracks, index))
    unknown = dilate(regions.hands(tracks), 1) & ~visible
    return Completed(*complete_shape(path, frames.frame, visible, hidden_by & ~visible, unknown))
