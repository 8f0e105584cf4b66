"""Frames of a folder of images, upright and at working size."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from afford.common.bounded import TooLargeError, check_image
from afford.common.errors import SourceError
from afford.common.video.size import shrink


def read_stills(pictures: Iterable[tuple[str, bytes]], box_wh: tuple[int, int]) -> np.ndarray:
    """Images (t, h, w, 3) uint8 RGB of (name, bytes). SourceError names the one that is no image, or not of the first's size."""
    images: list[np.ndarray] = []
    first = ""
    for name, data in pictures:
        image, first = _decode(name, data, box_wh), first or name
        if images and image.shape != images[0].shape:
            raise SourceError(name, f"the shape of {first}, {_size(images[0])}", _size(image),
                              "frames of a video must have one shape")
        images.append(image)
    return np.stack(images)


def _decode(name: str, data: bytes, box_wh: tuple[int, int]) -> np.ndarray:
    try:
        check_image(data, name)
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    except TooLargeError:
        raise
    except (SourceError, cv2.error):
        image = None
    if image is None:
        raise SourceError(name, "an image", f"{len(data)} bytes that cannot be decoded", "get the file again")
    return shrink(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), box_wh)


def _size(image: np.ndarray) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"
