"""Pictures as bytes: JPEG for the eye, PNG of 0 and 255 for masks, RGBA for overlays."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from afford.common.encode import encode_jpeg, encode_png
from afford.common.palette import Palette

JPEG_QUALITY = 90
PNG = (cv2.IMWRITE_PNG_COMPRESSION, 2, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE)
"""unfiltered: five times as fast as libpng's choice, and as small for flat pictures"""
OPACITY = 150


def jpeg(rgb: np.ndarray) -> bytes:
    """JPEG of (h, w, 3) uint8 sRGB."""
    return encode_jpeg(rgb, JPEG_QUALITY).tobytes()


def mask_png(mask: np.ndarray) -> bytes:
    """PNG of (h, w) bool, 0 and 255, so that any viewer shows it."""
    return encode_png(mask.view(np.uint8) * np.uint8(255), PNG).tobytes()


def grey_png(values: np.ndarray) -> bytes:
    """PNG of (h, w) uint8."""
    return encode_png(values, PNG).tobytes()


def colour_png(labels: np.ndarray, palette: Palette) -> bytes:
    """PNG of (h, w) uint8 labels, each painted in its colour of the palette."""
    return encode_png(_painted(labels, [(*colour, 255) for colour in palette])[..., :3], PNG).tobytes()


def overlay_png(masks: np.ndarray, palette: Palette) -> bytes:
    """Transparent PNG of (n, h, w) bool masks; a later mask lies over an earlier one."""
    labels = np.zeros(masks.shape[1:], np.uint8)
    for n, mask in enumerate(masks, 1):
        np.copyto(labels, np.uint8(n), where=mask)
    return encode_png(_painted(labels, [(0, 0, 0, 0), *((*colour, OPACITY) for colour in palette)]), PNG).tobytes()


def _painted(labels: np.ndarray, rgba: Sequence[tuple[int, ...]]) -> np.ndarray:
    """(h, w, 4) uint8 in the order that OpenCV writes: blue, green, red, alpha."""
    words = np.array(rgba, np.uint8)[:, [2, 1, 0, 3]].copy().view(np.uint32).reshape(-1)
    return np.take(words, labels).view(np.uint8).reshape(*labels.shape, 4)
