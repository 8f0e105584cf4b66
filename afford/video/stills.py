"""Frames of a folder of images, upright and at working size."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from afford.video.size import shrink


def read_stills(paths: Sequence[Path], names: Sequence[str], box_wh: tuple[int, int]) -> np.ndarray:
    """Images (t, h, w, 3) uint8 RGB. ValueError names the file that is no image, or whose size is not that of the first."""
    images: list[np.ndarray] = []
    for path, name in zip(paths, names, strict=True):
        image = _read(path, name, box_wh)
        if images and image.shape != images[0].shape:
            raise ValueError(f"{name}: expected the shape of {names[0]}, {_size(images[0])}, got {_size(image)}; "
                             "frames of a video must have one shape")
        images.append(image)
    return np.stack(images)


def _read(path: Path, name: str, box_wh: tuple[int, int]) -> np.ndarray:
    data = np.fromfile(path, np.uint8)
    image = cv2.imdecode(data, cv2.IMREAD_COLOR) if len(data) else None
    if image is None:
        raise ValueError(f"{name}: expected an image, got {len(data)} bytes that cannot be decoded; get the file again")
    return shrink(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), box_wh)


def _size(image: np.ndarray) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"
