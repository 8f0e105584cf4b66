"""The visible part is taken for the whole: the baseline that completion has to beat."""

from __future__ import annotations

import cv2
import numpy as np

from afford.common.masks import dilate
from afford.extraction import layers
from afford.extraction.complete import Completed
from afford.extraction.layers.follow import follow
from afford.extraction.layers.shape import carry, complete_shape, holding
from schemas.masks import Tracks
from schemas.video import Frames, Inpainted


def visible(frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: None) -> Completed:
    """The mask of the tracks, with the tracks' confidence."""
    return Completed(tracks.masks[index], tracks.confidence[index])


def hull(frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: None) -> Completed:
    """Hull of each frame's visible mask, with half the tracks' confidence."""
    return Completed(np.stack([convex_hull(mask) for mask in tracks.masks[index]]), tracks.confidence[index] * np.float32(0.5))


def convex_hull(mask: np.ndarray) -> np.ndarray:
    """(h, w) bool: the convex hull of the mask's pixels; empty when the mask is."""
    if not mask.any():
        return mask
    corners = cv2.convexHull(cv2.findNonZero(mask.view(np.uint8)))
    return cv2.fillConvexPoly(np.zeros(mask.shape, np.uint8), corners, 1) > 0


def template(frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: None) -> Completed:
    """Follow the object, carry it with the hand while hardly any of it shows, then let all frames vote on its hidden pixels.

    What no frame has seen is guessed behind hands only: things that touch each other seldom hide much.
    """
    grey = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in frames.rgb])
    visible, hidden_by = tracks.masks[index], dilate(layers.others(tracks, index), 1)
    path = carry(follow(grey, visible, hidden_by), grey, visible, holding(tracks, index))
    unknown = dilate(layers.hands(tracks), 1) & ~visible
    return Completed(*complete_shape(path, frames.frame, visible, hidden_by & ~visible, unknown))
