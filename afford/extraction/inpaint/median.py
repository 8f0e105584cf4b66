"""Background only: every pixel of the hole from other frames, registered by one homography each."""

from __future__ import annotations

import cv2
import numpy as np

from afford.extraction.inpaint import Filled
from afford.extraction.inpaint.layered import fill_background
from schemas.masks import Tracks
from schemas.video import Frames


def inpaint(frames: Frames, tracks: Tracks, hole: np.ndarray, params: None) -> Filled:
    """Robust mean over registered frames; objects behind hands are not followed."""
    grey = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in frames.rgb])
    return fill_background(frames, grey, tracks, hole)
