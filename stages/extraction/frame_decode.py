"""Decode the frames of a clip at working size from a video or frame images, with exact data-set numbers and times.

Reads   FileTree of the media, Footage: neither outlines nor narrations, so that a change of those decodes no frame again
Writes  Frames: rgb (t, h, w, 3) uint8 sRGB, frame (t,) data-set numbers, time_ns (t,) from the start of the video
Method  frames are identified by presentation time, so variable rates and reordering are supported; EPIC-KITCHENS videos are
        resampled to 60 or 50 frames/s as for their annotation; display rotation is applied; sizes shrink by area mean
Fails   when the file cannot be read or has too many pixels, or no key frame (without key frames: no frame) can be decoded;
        frames after a truncation are absent
Paper   VISOR (frame extraction), EPIC-KITCHENS-100 (456 x 256 frames)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.video import Footage, Frames

LIBRARIES = ("numpy", "opencv-python-headless", "av", "pillow")
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    """Parameters of `frame_decode`."""

    width_px: int = 456
    """frames are scaled down to fit into width_px x height_px, with their aspect ratio; upright video into the upright box"""
    height_px: int = 256
    """see width_px"""


def run(media: FileTree, footage: Footage, params: Params) -> Frames:
    """Decode first_frame to last_frame of a clip; ValueError names the file when it cannot be used."""
    from afford.common.video.frames import decode_clip

    return decode_clip(media, footage, (params.width_px, params.height_px))
