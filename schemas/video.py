"""Frames of a clip at working size, before and after the hands are removed."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

from schemas.spec import Schema, array, value

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True)
class Frames(Schema):
    """Decoded frames. Not necessarily consecutive: a source without video has its key frames only."""

    clip_id: str = value("clip")
    frame: np.ndarray = array("t", "int64", "frame numbers of the data set, ascending")
    time_ns: np.ndarray = array("t", "int64", "media time from the start of the video", unit="ns")
    rgb: np.ndarray = array("t h w 3", "uint8", "RGB images", unit="0..255 sRGB", encoding="video")


class PixelSource(IntEnum):
    """Where a pixel of an inpainted frame comes from."""

    ORIGINAL = 0
    BACKGROUND = 1
    OBJECT = 2
    SPATIAL = 3


@dataclass(frozen=True)
class Inpainted(Schema):
    """Frames with the hands removed. Outside `mask` the pixels are those of `Frames`, to the bit."""

    clip_id: str = value("clip")
    frame: np.ndarray = array("t", "int64", "frame numbers of the data set, ascending")
    rgb: np.ndarray = array("t h w 3", "uint8", "RGB images without hands", unit="0..255 sRGB", encoding="video")
    mask: np.ndarray = array("t h w", "bool", "pixels that were replaced: hands, dilated", encoding="rle")
    source: np.ndarray = array("t h w", "uint8", "PixelSource of each pixel", encoding="zstd")
    confidence: np.ndarray = array("t h w", "uint8", "255 = seen directly, 0 = guessed", encoding="zstd")
