"""The working size of frames."""

from __future__ import annotations

import cv2
import numpy as np


def fit(width_px: int, height_px: int, box_wh: tuple[int, int]) -> tuple[int, int]:
    """(width, height) of an image scaled down into a box, its shape kept, both even; upright images turn the box upright.

    Small images stay as they are (cut to even numbers by scaling).
    """
    long_px, short_px = max(box_wh), min(box_wh)
    box_w, box_h = (long_px, short_px) if width_px >= height_px else (short_px, long_px)
    scale = min(1.0, box_w / width_px, box_h / height_px)
    return _even(width_px * scale), _even(height_px * scale)


def _even(length: float) -> int:
    return max(2, 2 * round(length / 2))


def shrink(image: np.ndarray, box_wh: tuple[int, int]) -> np.ndarray:
    """An (h, w, 3) uint8 image at its working size; each pixel is the mean of the area it covers."""
    size = fit(image.shape[1], image.shape[0], box_wh)
    if size == (image.shape[1], image.shape[0]):
        return image
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)
