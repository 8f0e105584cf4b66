"""Complete objects without weights: `template` by votes of all frames, and the baselines `visible` and `hull`."""

from __future__ import annotations

import cv2
import numpy as np

from afford.common.masks import dilate
from afford.extraction import layers
from afford.extraction.complete import Completed
from afford.extraction.layers.shape import complete_shape, holding_hands, propagate_while_held
from afford.extraction.layers.template import track_template
from schemas.masks import Tracks
from schemas.video import Frames, Inpainted


def visible(frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: None) -> Completed:
    """Return the visible mask as the complete one, with the confidence of the tracks."""
    return Completed(tracks.masks[index], tracks.confidence[index])


def hull(frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: None) -> Completed:
    """Complete by the convex hull of the visible mask of each frame, with half the confidence of the tracks."""
    return Completed(np.stack([convex_hull(mask) for mask in tracks.masks[index]]), tracks.confidence[index] * np.float32(0.5))


def convex_hull(mask: np.ndarray) -> np.ndarray:
    """Fill the convex hull of a mask (h, w) bool; an empty mask stays empty."""
    if not mask.any():
        return mask
    corners = cv2.convexHull(cv2.findNonZero(mask.view(np.uint8)))
    return cv2.fillConvexPoly(np.zeros(mask.shape, np.uint8), corners, 1) > 0


def template(frames: Frames, tracks: Tracks, inpainted: Inpainted, index: int, params: None) -> Completed:
    """Track the object by a template, move it with the hand while it is mostly hidden, then vote on its hidden pixels.

    Pixels that no frame shows are extrapolated behind hands only: objects that touch each other seldom occlude much.
    """
    grey = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in frames.rgb])
    seen, hidden_by = tracks.masks[index], dilate(layers.others(tracks, index), 1)
    path = propagate_while_held(track_template(grey, seen, hidden_by), grey, seen, holding_hands(tracks, index))
    unknown = dilate(layers.hands(tracks), 1) & ~seen
    return Completed(*complete_shape(path, frames.frame, seen, hidden_by & ~seen, unknown))
