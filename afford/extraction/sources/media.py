"""Media of one video, a video file or frame images: existing frame numbers, their times, and the check for partial downloads."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Literal

import numpy as np

from afford.common import folders
from afford.common.errors import SourceError
from afford.common.folders import IMAGE_SUFFIXES, VIDEO_SUFFIXES, is_pack
from afford.common.video.probe import Probe, epic_rate, frames_at, probe
from afford.extraction.sources.narrations import INFO
from afford.extraction.sources.tables import read_table
from afford.extraction.sources.visor import frame_number
from schemas.files import FileRef, FileTree


@dataclass(frozen=True)
class Media:
    """The frames of a video that exist."""

    kind: Literal["video", "frames"]
    names: tuple[str, ...]
    """the video file, or the images in frame order"""
    numbers: np.ndarray
    """(n,) int64 frame numbers that exist, ascending"""
    times_s: np.ndarray
    """(n,) float64 time of each frame, from the start of the video"""
    fps: float
    resample: bool
    truncated: bool
    """the file ends before the length in its container"""
    spans: tuple[folders.Span, ...] = ()
    """(offset, size) of every image, bytes, where a tar holds them"""
    size_wh: tuple[int, int] | None = None
    """width and height of the video's frames as stored, px; None for images"""

    def frame_at(self, seconds: float) -> int:
        """Number of the frame at a time; the first or the last frame outside the video."""
        return int(self.numbers[max(int(np.searchsorted(self.times_s, seconds + 1e-6, side="right")) - 1, 0)])


def find_media(files: FileTree, rates: Mapping[str, float], still_fps: float) -> Media:
    """Read the header of the video file of a tree, or the names and sizes of its images in a tar, a zip or a folder.

    rates: video id -> frames per second of a folder of images, where the source has it (else `still_fps`). SourceError when the
    video cannot be read, an archive is truncated, or images are empty.
    """
    video = next((file for file in files.files if PurePosixPath(file.name).suffix.lower() in VIDEO_SUFFIXES), None)
    rate = epic_rate(files.name)
    if video is not None:
        return _of_video(video, rate)
    fps = rate or rates.get(files.name, still_fps)
    whole = next((file for file in files.files if is_pack(file.name)), None)
    if whole is not None:
        return _of_pack(whole, fps)
    images = [file for file in files.files if PurePosixPath(file.name).suffix.lower() in IMAGE_SUFFIXES]
    return _of_images([image.name for image in images], [image.size for image in images], fps)


def _of_video(video: FileRef, rate: float | None) -> Media:
    info = _probe_video(video)
    count = len(frames_at(info, rate, video.name))
    numbers = np.arange(1, count + 1, dtype=np.int64)
    times_s = (numbers - 1) / rate if rate else info.times_s
    return Media("video", (video.name,), numbers, times_s, rate or info.fps, rate is not None, info.truncated, size_wh=info.size_wh)


def _probe_video(video: FileRef) -> Probe:
    if video.size == 0:
        raise SourceError(video.name, "a video", "an empty file (0 bytes)", "get the file again")
    return probe(video.path, video.name)


def _of_pack(whole: FileRef, fps: float) -> Media:
    try:
        inside = folders.index_pack(whole.path)
    except ValueError as error:
        raise SourceError(whole.name, "a whole archive", str(error), "get the file again") from error
    if not inside.names:
        raise SourceError(whole.name, "frame images in it", "no images", "is it the archive of the frames? get it again")
    return _of_images([f"{whole.name}/{name}" for name in inside.names], inside.sizes, fps, inside.spans)


def _of_images(names: list[str], sizes: Sequence[int], fps: float, spans: tuple[folders.Span, ...] = ()) -> Media:
    if not names:
        raise SourceError("media", "a video file or frame images", "neither", "see docs/extraction/own-video.md")
    empty = [name for name, size in zip(names, sizes, strict=True) if size == 0]
    if empty:
        raise SourceError(empty[0], "an image", f"0 bytes, as of {len(empty)} of {len(names)} frames", "get these files again")
    found = np.array([frame_number(name, name) for name in names], np.int64)
    order = np.argsort(found, kind="stable")
    numbers = found[order]
    if (np.diff(numbers) == 0).any():
        at = int(np.flatnonzero(np.diff(numbers) == 0)[0])
        raise SourceError(names[order[at + 1]], "one image per frame number", f"also {names[order[at]]}", "remove one of the two")
    return Media("frames", tuple(names[i] for i in order), numbers, (numbers - 1) / fps, fps, resample=False, truncated=False,
                 spans=tuple(spans[i] for i in order) if spans else ())


END_SLACK_S = 2.0
"""tolerance of the end of the frames: tools that extract frames disagree at the end of a file"""
DENSE_SHARE = 0.5
"""images that cover at least this share of the frame numbers are all frames of a video, not its key frames alone"""


def check_end(files: FileTree, media: Media) -> None:
    """Raise SourceError for a partial download: images that end before the length of the video in EPIC_100_video_info.csv.

    Key frames alone pass, and video files, which contain their own length.
    """
    last = int(media.numbers[-1])
    if media.kind == "video" or len(media.numbers) < DENSE_SHARE * (last - int(media.numbers[0]) + 1):
        return
    length_s = _length_s(files)
    if length_s is not None and media.times_s[-1] < length_s - END_SLACK_S:
        wanted = f"frames to about {int(length_s * media.fps)} ({INFO}: {length_s:.1f} s at {media.fps:g} frames/s)"
        raise SourceError(media.names[0].rpartition("/")[0] or media.names[0], wanted, f"{len(media.numbers)} up to {last}",
                          "the download or the unpacking is not complete; finish it")


def _length_s(files: FileTree) -> float | None:
    info = files.find(INFO)
    for where, row in read_table(info.path.read_bytes(), INFO, ("video_id", "fps")) if info else ():
        if row["video_id"] == files.name and row.get("duration"):
            return _seconds(row["duration"], where)
    return None


def _seconds(text: str, where: str) -> float:
    try:
        length_s = float(text)
    except ValueError:
        length_s = math.nan
    if not math.isfinite(length_s):
        raise SourceError(f"{where}, column 'duration'", "seconds", repr(text), "correct the row")
    return length_s
