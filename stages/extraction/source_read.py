"""Read the files of one video into clips: key-frame outlines, contacts and narrations, without decoding frames.

Reads   FileTree: video or frame images (files, or in a tar, a zip, a large folder), VISOR or COCO masks or none, tables of
        narrations, classes, lengths, VISOR's frame numbers and corrected contacts
Writes  tuple of Clip, by time; long videos are cut where key frames are far apart; clips without masks have no key frames yet
Method  afford/extraction/sources handles the quirks of each format; corrections and omissions are listed in Clip.warnings
Fails   SourceError, one sentence: file, field, expected, got, what to do; other videos are not affected
Paper   VISOR (annotation format), EPIC-KITCHENS-100 (narrations), 2HandedAfforder section 3 (input)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.video import Clip

LIBRARIES = ("numpy", "opencv-python-headless", "av", "pycocotools")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of `source_read`."""

    max_gap_s: float = 3.0
    """a video is cut between key frames farther apart than this; annotated key frames are about 0.7 to 2 s apart"""
    max_still_gap_s: float = 30.0
    """the same limit where no frames exist between the key frames, so that tracking is not needed"""
    max_frames: int = 900
    """longer clips are cut at a key frame, which both sides keep"""
    margin_frames: int = 10
    """frames kept before the first and after the last key frame, where they exist (10 frames ahead in the released code)"""
    still_fps: float = 30.0
    """frame rate, 1/s, of a folder of images without a known rate"""


def run(files: FileTree, params: Params) -> tuple[Clip, ...]:
    """Read the clips of one video; ValueError when a parameter is out of range."""
    from afford.extraction.sources.cut import Cutting
    from afford.extraction.sources.read import read_clips

    if params.max_frames < 2 or params.margin_frames < 0 or params.still_fps <= 0:
        raise ValueError("source_read: expected max_frames of 2 or more, margin_frames of 0 or more and a positive still_fps, "
                         f"got {params.max_frames}, {params.margin_frames} and {params.still_fps}")
    cutting = Cutting(params.max_gap_s, params.max_still_gap_s, params.max_frames, params.margin_frames)
    return read_clips(files, cutting, params.still_fps)
