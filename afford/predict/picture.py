"""Bytes -> a picture: upright RGB, or one sentence about why not. The size is read before anything is decoded."""

from __future__ import annotations

import io
import warnings
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError

from afford.readers.errors import SourceError

MAX_PIXELS = 64_000_000
"""larger than any camera's picture; the probabilities of 6 regions take 24 bytes a pixel"""


class TooLargeError(SourceError):
    """A picture with more pixels than are allowed."""


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
    return decode(data, str(path))


def decode(data: bytes, name: str, max_pixels: int = MAX_PIXELS) -> np.ndarray:
    """(h, w, 3) uint8 RGB, turned as EXIF asks; transparency is dropped. SourceError (TooLargeError) when it cannot be had."""
    width, height = _size(data, name)
    if width * height > max_pixels:
        raise TooLargeError(name, f"an image of at most {max_pixels / 1e6:g} megapixels", f"{width} x {height}", "make it smaller")
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_BGR)
    if bgr is None:
        raise _not_an_image(name, len(data))
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)


def _size(data: bytes, name: str) -> tuple[int, int]:
    """Width and height as the header states them; Pillow's own limit is above ours, or says the same."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data)) as header:
                return header.size
    except Image.DecompressionBombError as error:
        raise TooLargeError(name, "an image of a camera's size", "one of far more pixels", "make it smaller") from error
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as error:
        raise _not_an_image(name, len(data)) from error


def _not_an_image(name: str, length: int) -> SourceError:
    got = f"{length} bytes that cannot be decoded" if length else "an empty file"
    return SourceError(name, "an image (JPEG, PNG, WebP, BMP or TIFF)", got, "give another file")
