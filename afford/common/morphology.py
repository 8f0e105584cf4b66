"""Masks grown and shrunk by a disc."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np


def dilate(mask: np.ndarray, radius_px: int) -> np.ndarray:
    """(h, w) or (t, h, w) bool, grown by a disc. Radius 0 returns the mask itself."""
    return _morph(cv2.dilate, mask, radius_px)


def erode(mask: np.ndarray, radius_px: int) -> np.ndarray:
    """(h, w) or (t, h, w) bool, shrunk by a disc; the image border does not erode."""
    return _morph(cv2.erode, mask, radius_px)


def _morph(operation: Callable[..., np.ndarray], mask: np.ndarray, radius_px: int) -> np.ndarray:
    if radius_px == 0:
        return mask
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius_px + 1, 2 * radius_px + 1))
    if mask.ndim == 3:
        return np.stack([operation(one.view(np.uint8), disc) > 0 for one in mask]) if len(mask) else mask
    return operation(mask.view(np.uint8), disc) > 0
