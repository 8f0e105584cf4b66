"""Bytes -> a picture: upright RGB, or one sentence about why not. The size is read before anything is decoded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from afford.common.bounded import MAX_PIXELS, check_image, not_an_image
from afford.common.errors import SourceError


@dataclass(frozen=True)
class Picture:
    """One image that a model can be asked about."""

    name: str
    """what it is called in every message and in the output, without suffix: `tea/kettle`, `clip/frame_0000011`"""
    source: str
    """the file that it comes from, as the user named it"""
    rgb: np.ndarray
    """(h, w, 3) uint8"""
    frame: int | None = None
    """number of the frame in its video, from 1"""
    time_s: float | None = None
    """time of the frame in its video"""


def read_image(path: Path) -> np.ndarray:
    """(h, w, 3) uint8 RGB, upright. SourceError when the file is no image that can be read."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SourceError(str(path), "an image", error.strerror or str(error), "check the path") from error
    return decode_image(data, str(path))


def decode_image(data: bytes, name: str, max_pixels: int = MAX_PIXELS) -> np.ndarray:
    """(h, w, 3) uint8 RGB, turned as EXIF asks; transparency is dropped. SourceError (TooLargeError) when it cannot be had."""
    check_image(data, name, max_pixels)
    try:
        bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_BGR)
    except cv2.error as error:
        raise not_an_image(name, len(data)) from error
    if bgr is None:
        raise not_an_image(name, len(data))
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
