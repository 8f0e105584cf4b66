"""Signed distance to an outline of which parts may be hidden, with a weight that is 0 where the hidden part could matter."""

from __future__ import annotations

import cv2
import numpy as np

REACH_PX = 6.0


def signed_distance(inside: np.ndarray, known: np.ndarray, reach_px: float = REACH_PX) -> tuple[np.ndarray, np.ndarray]:
    """(h, w) float32 distance (px, inside positive, cut at +-`reach_px`) and its (h, w) float32 weight, 0 or 1.

    inside: (h, w) bool, a subset of known: (h, w) bool, pixels where it is certain whether they belong to the shape. A
    distance counts only where no unknown pixel is nearer than the outline, because the outline may run through there.
    """
    background = known & ~inside
    distance = np.where(inside, _to(background), -_to(inside)) - np.where(inside, 0.5, -0.5).astype(np.float32)
    distance = np.clip(distance, -reach_px, reach_px)
    return distance, (known & (_to(~known) > np.abs(distance))).astype(np.float32)


def _to(target: np.ndarray) -> np.ndarray:
    """Distance of every pixel to the nearest pixel of `target`; a large number when there is none."""
    return cv2.distanceTransform((~target).view(np.uint8), cv2.DIST_L2, 3)
