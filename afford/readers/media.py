"""The video file or the frame images of one video: which frame numbers there are, and how seconds become frame numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Literal

import numpy as np

from afford.readers.errors import SourceError
from afford.readers.folder import IMAGE_SUFFIXES, VIDEO_SUFFIXES
from afford.readers.visor import frame_number
from afford.video.number import epic_rate, shown
from afford.video.probe import Probe, probe
from schemas.files import FileRef, FileTree


@dataclass(frozen=True)
class Media:
    """Frames that exist."""

    kind: Literal["video", "frames"]
    names: tuple[str, ...]
    """the video file, or the images in frame order"""
    numbers: np.ndarray
    """(n,) int64 frame numbers that exist, ascending"""
    times_s: np.ndarray
    """(n,) float64 time of each, from the start of the video"""
    fps: float
    resample: bool
    truncated: bool
    """the file ends before the container says so"""

    def frame_at(self, seconds: float) -> int:
        """Number of the frame that is shown at a time; the first or last one outside the video."""
        return int(self.numbers[max(int(np.searchsorted(self.times_s, seconds + 1e-6, side="right")) - 1, 0)])


def find_media(files: FileTree, rates: Mapping[str, float], still_fps: float) -> Media:
    """Look at the video file of a tree, or at the names of its images.

    rates: video id -> frames per second of a folder of images, where the source states it (else `still_fps`). SourceError
    when the video cannot be read.
    """
    video = next((file for file in files.files if PurePosixPath(file.name).suffix.lower() in VIDEO_SUFFIXES), None)
    rate = epic_rate(files.name)
    if video is not None:
        return _of_video(video, rate)
    images = [file.name for file in files.files if PurePosixPath(file.name).suffix.lower() in IMAGE_SUFFIXES]
    return _of_images(images, rate or rates.get(files.name, still_fps))


def _of_video(video: FileRef, rate: float | None) -> Media:
    info = _probe(video)
    count = len(shown(info.times_s, rate))
    numbers = np.arange(1, count + 1, dtype=np.int64)
    times_s = (numbers - 1) / rate if rate else info.times_s
    return Media("video", (video.name,), numbers, times_s, rate or info.fps, rate is not None, info.truncated)


def _probe(video: FileRef) -> Probe:
    if video.size == 0:
        raise SourceError(video.name, "a video", "an empty file (0 bytes)", "get the file again")
    try:
        return probe(video.path)
    except ValueError as error:
        raise SourceError(video.name, "a video that can be read", str(error), "is the file cut short? get it again") from error


def _of_images(names: list[str], fps: float) -> Media:
    if not names:
        raise SourceError("media", "a video file or frame images", "neither", "see docs/own-video.md")
    numbered = sorted((frame_number(name, name), name) for name in names)
    numbers = np.array([number for number, _ in numbered], np.int64)
    if (np.diff(numbers) == 0).any():
        at = int(np.flatnonzero(np.diff(numbers) == 0)[0])
        raise SourceError(numbered[at + 1][1], "one image per frame number", f"also {numbered[at][1]}", "remove one of the two")
    ordered = tuple(name for _, name in numbered)
    return Media("frames", ordered, numbers, (numbers - 1) / fps, fps, resample=False, truncated=False)
