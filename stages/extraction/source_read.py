"""files of one video -> clips: key-frame outlines, contacts and narrations, before a pixel is decoded.

Reads   FileTree: video or frame images (files, or in a tar, a zip, a large folder), VISOR or COCO masks or none, tables of
        narrations, classes, lengths, VISOR's frame numbers and corrected contacts
Writes  tuple of Clip, by time; long videos are cut where key frames are far apart; without masks they have no key frames yet
Method  the quirks of each format are dealt with in afford/extraction/sources; what was corrected or left out is in Clip.warnings
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
    max_gap_s: float = 3.0
    """a video is cut between key frames farther apart than this; annotators left about 0.7 to 2 s between them"""
    max_still_gap_s: float = 30.0
    """the same where no frames exist between the key frames, so that nothing has to be followed"""
    max_frames: int = 900
    """longer clips are cut at a key frame, which both sides keep"""
    margin_frames: int = 10
    """frames kept before the first and after the last key frame, where they exist (the released code looks 10 frames ahead)"""
    still_fps: float = 30.0
    """frame rate, 1/s, of a folder of images for which nothing states one"""


def run(files: FileTree, params: Params) -> tuple[Clip, ...]:
    """Read everything about one video; ValueError when a parameter is out of range."""
    from afford.extraction.sources.cut import Cutting
    from afford.extraction.sources.read import read_clips

    if params.max_frames < 2 or params.margin_frames < 0 or params.still_fps <= 0:
        raise ValueError("source_read: expected max_frames of 2 or more, margin_frames of 0 or more and a positive still_fps, "
                         f"got {params.max_frames}, {params.margin_frames} and {params.still_fps}")
    cutting = Cutting(params.max_gap_s, params.max_still_gap_s, params.max_frames, params.margin_frames)
    return read_clips(files, cutting, params.still_fps)
