"""Frame numbers of a data set <-> frames of a video file."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

import numpy as np

EPIC_ID = re.compile(r"P(0[1-9]|[12][0-9]|3[0-7])_([0-9]{2}|1[0-9]{2})")
LAST_FRAME = 10**12
"""a number beyond it is none of a frame, but a time or an id"""
MOST_SLOTS = 2**26
"""frames of a video at a constant rate: 13 days at 60 a second; times that are damaged claim more"""


def epic_rate(video_id: str) -> float | None:
    """The rate, 1/s, that EPIC-KITCHENS numbers frames by, whatever the rate of the file: 60 for PXX_YY, 50 for PXX_1YY, P01
    to P37; None for every other id. VISOR, frame extraction.
    """
    match = EPIC_ID.fullmatch(video_id)
    if match is None:
        return None
    return 60.0 if len(match[2]) == 2 else 50.0


def parse_frame_number(name: str) -> int | None:
    """The last run of digits of an image's name: rgb_frames/P03_101_frame_0000000157.jpg shows frame 157. None without one, and
    for a number beyond `LAST_FRAME`.
    """
    digits = re.findall(r"[0-9]+", PurePosixPath(name).stem)
    last = digits[-1].lstrip("0") if digits else None
    if last is None or len(last) > len(str(LAST_FRAME)):
        return None
    number = int(last or 0)
    return number if number <= LAST_FRAME else None


def resampled_frames(times_s: np.ndarray, fps: float | None) -> np.ndarray:
    """Which frame of the file each data-set frame shows: (n,) int64, entry k for frame number k + 1.

    Without `fps` frame n is the n-th of the file. With it the file is resampled as ffmpeg does at a constant rate: each
    picture takes the slot nearest to its time, and empty slots repeat the picture before. ValueError for more than `MOST_SLOTS`.
    """
    if fps is None:
        return np.arange(len(times_s))
    if not times_s[-1] * fps < MOST_SLOTS:
        raise ValueError(f"times up to {times_s[-1]:.0f} s, which are those of no video")
    slots = np.floor(times_s * fps + 0.5).astype(np.int64)
    step_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 1 / fps
    count = max(int(np.floor((times_s[-1] + step_s) * fps + 0.5)), int(slots[-1]) + 1)
    return np.maximum(np.searchsorted(slots, np.arange(count), side="right") - 1, 0)
