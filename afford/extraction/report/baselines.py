"""The plain methods that every stage has to beat."""

from __future__ import annotations

import cv2
import numpy as np


def nearest_key(masks: np.ndarray, is_key: np.ndarray) -> np.ndarray:
    """Copy the masks (n, t, h, w) of the nearest key frame, earlier on a tie; `is_key` is (t,) bool with at least one True."""
    keys = np.flatnonzero(is_key)
    nearest = keys[np.abs(np.arange(masks.shape[1])[:, None] - keys[None]).argmin(axis=1)]
    return masks[:, nearest]


def telea(rgb: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """`cv2.inpaint` (Telea 2004, radius 3 px) of one (h, w, 3) uint8 frame inside an (h, w) bool mask."""
    return cv2.inpaint(rgb, mask.astype(np.uint8), 3, cv2.INPAINT_TELEA)


def hull(visible: np.ndarray, hands: np.ndarray) -> np.ndarray:
    """The visible mask (h, w) and, inside the hands, its convex hull."""
    if not visible.any():
        return visible
    points = cv2.findNonZero(visible.astype(np.uint8))
    filled = cv2.fillConvexPoly(np.zeros(visible.shape, np.uint8), cv2.convexHull(points), 1) > 0
    return visible | (filled & hands)
