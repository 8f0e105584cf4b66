"""Pixels -> the bytes of a JPEG or PNG file."""

from __future__ import annotations

import cv2
import numpy as np


def encode_jpeg(rgb: np.ndarray, quality: int) -> np.ndarray:
    """(h, w, 3) uint8 RGB -> (b,) uint8, the file; quality 0..100."""
    return _file(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), (cv2.IMWRITE_JPEG_QUALITY, quality))


def encode_png(picture: np.ndarray, options: tuple[int, ...] = ()) -> np.ndarray:
    """(h, w) grey, (h, w, 3) BGR or (h, w, 4) BGRA uint8, in the order of OpenCV, whose options these are -> (b,) uint8."""
    return _file(".png", picture, options)


def _file(kind: str, picture: np.ndarray, options: tuple[int, ...]) -> np.ndarray:
    done, data = cv2.imencode(kind, picture, options)
    if not done:
        raise ValueError(f"cannot encode a picture of shape {picture.shape} as {kind}")
    return np.asarray(data).reshape(-1)
