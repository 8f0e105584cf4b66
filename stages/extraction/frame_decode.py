"""video or frame images -> the frames of a clip at working size, with exact data-set numbers and times.

Reads   FileTree of the media, Footage: neither outlines nor words, so that a change of those decodes nothing again
Writes  Frames: rgb (t, h, w, 3) uint8 sRGB, frame (t,) data-set numbers, time_ns (t,) from the start of the video
Method  frames are told apart by presentation time, so variable rates and reordering do no harm; EPIC-KITCHENS videos are
        resampled to 60 or 50 frames/s as their annotators did; display rotation is applied; sizes shrink by area mean
Fails   the file cannot be read or states too many pixels, or no key frame of the clip can be decoded (no frame, where none is
        known yet); frames after a truncation are merely absent
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
    width_px: int = 456
    """frames are scaled down into width_px x height_px, their shape kept; upright video into the upright box"""
    height_px: int = 256
    """see width_px"""


def run(media: FileTree, footage: Footage, params: Params) -> Frames:
    """Decode first_frame to last_frame of a clip; ValueError names the file when it cannot be used."""
    from afford.common.video.frames import decode_clip

    return decode_clip(media, footage, (params.width_px, params.height_px))
