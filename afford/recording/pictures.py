"""Pictures as bytes: JPEG for the eye, PNG of 0 and 255 for masks, RGBA for overlays."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

JPEG_QUALITY = 90
PNG = (cv2.IMWRITE_PNG_COMPRESSION, 2)
Palette = Sequence[tuple[int, int, int]]
"""one RGB colour per label or mask"""
LEFT, RIGHT = (66, 165, 245), (239, 83, 80)
OBJECTS = ((102, 187, 106), (255, 202, 40), (171, 71, 188), (38, 198, 218), (255, 112, 67), (156, 204, 101), (236, 64, 122),
           (121, 134, 203))  # fmt: skip
OPACITY = 150


def jpeg(rgb: np.ndarray) -> bytes:
    """JPEG of (h, w, 3) uint8 sRGB."""
    return _encode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))


def mask_png(mask: np.ndarray) -> bytes:
    """PNG of (h, w) bool, 0 and 255, so that any viewer shows it."""
    return _encode(".png", mask.view(np.uint8) * np.uint8(255), PNG)


def grey_png(values: np.ndarray) -> bytes:
    """PNG of (h, w) uint8."""
    return _encode(".png", values, PNG)


def colour_png(labels: np.ndarray, palette: Palette) -> bytes:
    """PNG of (h, w) labels, each painted in its colour of the palette."""
    return _encode(".png", np.array(palette, np.uint8)[labels][..., ::-1], PNG)


def overlay_png(masks: np.ndarray, palette: Palette) -> bytes:
    """Transparent PNG of (n, h, w) bool masks; a later mask lies over an earlier one."""
    rgba = np.zeros((*masks.shape[1:], 4), np.uint8)
    for mask, (red, green, blue) in zip(masks, palette, strict=True):
        rgba[mask] = (blue, green, red, OPACITY)
    return _encode(".png", rgba, PNG)


def palette(sides: Sequence[str]) -> Palette:
    """A colour for each entity by its side: 'left' and 'right' hands have their own, objects take turns."""
    objects = iter(range(len(sides)))
    hands = {"left": LEFT, "right": RIGHT}
    return [hands[side] if side in hands else OBJECTS[next(objects) % len(OBJECTS)] for side in sides]


def _encode(kind: str, picture: np.ndarray, options: tuple[int, int]) -> bytes:
    done, data = cv2.imencode(kind, picture, list(options))
    if not done:
        raise ValueError(f"cannot encode a picture of shape {picture.shape} as {kind}")
    return data.tobytes()
