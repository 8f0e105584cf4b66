"""Each frame alone: `cv2.inpaint` spreads the border of the hole inwards. The baseline that other frames have to beat."""

from __future__ import annotations

import cv2
import numpy as np

from afford.extraction.inpaint import Filled
from schemas.masks import Tracks
from schemas.video import Frames, PixelSource

RADIUS_PX = 3


def inpaint(frames: Frames, tracks: Tracks, hole: np.ndarray, params: None) -> Filled:
    """Telea 2004, radius 3 px. Confidence is 0: everything is guessed."""
    rgb = np.stack([spread(image, mask) for image, mask in zip(frames.rgb, hole, strict=True)])
    source = np.where(hole, PixelSource.SPATIAL, PixelSource.ORIGINAL).astype(np.uint8)
    return Filled(rgb, source, np.zeros(hole.shape, np.uint8))


def spread(image: np.ndarray, hole: np.ndarray) -> np.ndarray:
    """One (h, w, 3) uint8 image filled inside `hole` (h, w) bool; unchanged when the hole is empty."""
    return cv2.inpaint(image, hole.view(np.uint8), RADIUS_PX, cv2.INPAINT_TELEA) if hole.any() else image.copy()
