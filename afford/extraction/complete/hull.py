"""The convex hull of the visible part: right for a box behind a finger, blind to handles and to hidden ends."""

from __future__ import annotations

import cv2
import numpy as np

from afford.extraction.complete import Completed
from schemas.masks import Tracks
from schemas.video import Frames, Inpainted


def complete(frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: None) -> Completed:
    """Hull of each frame's visible mask, with half the tracks' confidence."""
    return Completed(np.stack([hull(mask) for mask in tracks.masks[index]]), tracks.confidence[index] * np.float32(0.5))


def hull(mask: np.ndarray) -> np.ndarray:
    """(h, w) bool: the convex hull of the mask's pixels; empty when the mask is."""
    if not mask.any():
        return mask
    corners = cv2.convexHull(cv2.findNonZero(mask.view(np.uint8)))
    return cv2.fillConvexPoly(np.zeros(mask.shape, np.uint8), corners, 1) > 0
