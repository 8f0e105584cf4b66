"""Probe a video file by its packets, without decoding, and map frame numbers of data sets to its frames."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import av
import numpy as np

from afford.common.bounded import MAX_PIXELS
from afford.common.errors import SourceError

EPIC_ID = re.compile(r"P(0[1-9]|[12][0-9]|3[0-7])_([0-9]{2}|1[0-9]{2})")
LAST_FRAME = 10**12
"""largest plausible frame number; larger numbers are times or ids"""
MOST_SLOTS = 2**26
"""most frames of a resampled video: 13 days at 60 frames per second; damaged times exceed it"""


def epic_rate(video_id: str) -> float | None:
    """Return the rate, 1/s, by which EPIC-KITCHENS numbers the frames of a video, independent of the file's rate.

    60 for PXX_YY, 50 for PXX_1YY, P01 to P37; None for any other id (VISOR, frame extraction).
    """
    match = EPIC_ID.fullmatch(video_id)
    if match is None:
        return None
    return 60.0 if len(match[2]) == 2 else 50.0


def parse_frame_number(name: str) -> int | None:
    """Parse the last run of digits in an image's name, such as 157 in rgb_frames/P03_101_frame_0000000157.jpg.

    None for a name without digits and for a number beyond `LAST_FRAME`.
    """
    digits = re.findall(r"[0-9]+", PurePosixPath(name).stem)
    last = digits[-1].lstrip("0") if digits else None
    if last is None or len(last) > len(str(LAST_FRAME)):
        return None
    number = int(last or 0)
    return number if number <= LAST_FRAME else None


def resampled_frames(times_s: np.ndarray, fps: float | None) -> np.ndarray:
    """Map data-set frames to frames of the file: (n,) int64, entry k for frame number k + 1.

    Without `fps`, frame n is the n-th of the file. With `fps`, the file is resampled to a constant rate as ffmpeg does: each image
    takes the slot nearest to its time, and an empty slot repeats the image before it. Raises ValueError beyond `MOST_SLOTS`.
    """
    if fps is None:
        return np.arange(len(times_s))
    if not times_s[-1] * fps < MOST_SLOTS:
        raise ValueError(f"times up to {times_s[-1]:.0f} s, which are those of no video")
    slots = np.floor(times_s * fps + 0.5).astype(np.int64)
    step_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 1 / fps
    count = max(int(np.floor((times_s[-1] + step_s) * fps + 0.5)), int(slots[-1]) + 1)
    return np.maximum(np.searchsorted(slots, np.arange(count), side="right") - 1, 0)


CONTAINERS = ("mov", "matroska", "avi", "mpeg", "mpegts", "mpegvideo", "m4v", "h264", "hevc", "obu", "ivf", "av1", "asf", "flv",
              "ogg", "mjpeg", "mxf", "dv", "nut", "rm", "gif", "vvc")  # fmt: skip
"""containers that contain their own frames. Playlists (ffconcat, HLS, DASH, SDP, IMF) are refused, because no digest covers the
files that they name
"""
OPTIONS = {"format_whitelist": ",".join(CONTAINERS), "protocol_whitelist": "file"}
LATE_S = 0.25
"""a video that ends this much before the stated duration is truncated"""


@dataclass(frozen=True)
class Probe:
    """Frames of a video in display order."""

    fps: float
    """average rate that the container states, 1/s"""
    pts: np.ndarray
    """(n,) int64 presentation times in `time_base_s`, ascending"""
    time_base_s: float
    is_key: np.ndarray
    """(n,) bool: decoding may start here"""
    truncated: bool
    """the file ends before the stated duration; the last frames, whose order is uncertain, are not counted"""
    size_wh: tuple[int, int]
    """width and height as stored, px; a display matrix may turn them"""

    @property
    def times_s(self) -> np.ndarray:
        """Return (n,) float64 seconds since the first frame."""
        return (self.pts - self.pts[0]) * self.time_base_s


def probe(path: Path, name: str = "") -> Probe:
    """Read the packets of the first video stream. SourceError when there is no stream or no readable packet."""
    with opened(path, name) as (container, stream):
        return _probe(container, stream, name or path.name)


@contextmanager
def opened(path: Path, name: str = "") -> Iterator[tuple[av.container.InputContainer, av.VideoStream]]:
    """Open a video file and its first video stream, on one thread; no other file is read.

    Raises SourceError, also for errors in the body of the `with` block: for a container outside `CONTAINERS`, for a file without a
    decodable video, and for frames of more than MAX_PIXELS.
    """
    try:
        with av.open(str(path.absolute()), options=OPTIONS) as container:
            yield container, _stream(container, name or path.name)
    except av.error.ArgumentError as error:  # of a container that is not on the list
        raise _unreadable(name or path.name, "a list of other files, or an unusual kind of file") from error
    except (av.error.FFmpegError, UnicodeDecodeError) as error:
        raise _unreadable(name or path.name, str(getattr(error, "strerror", None) or "unreadable data")) from error


def _stream(container: av.container.InputContainer, name: str) -> av.VideoStream:
    if not container.streams.video:
        raise _unreadable(name, "no video stream")
    stream = container.streams.video[0]
    codec = stream.codec_context
    if codec is None:
        raise _unreadable(name, "a video in a format that FFmpeg cannot decode")
    if codec.width * codec.height > MAX_PIXELS:
        raise _unreadable(name, f"frames of {codec.width} x {codec.height}, more than {MAX_PIXELS / 1e6:g} megapixels")
    codec.thread_count = 1
    codec.options = {"max_pixels": str(MAX_PIXELS)}
    return stream


def _unreadable(name: str, got: str) -> SourceError:
    return SourceError(name, "a video that can be read", got, "is the file cut short? get it again, or save it as MP4 or MKV")


def frames_at(info: Probe, fps: float | None, name: str) -> np.ndarray:
    """Map data-set frames to frames of the file (`resampled_frames`); SourceError for implausible times."""
    try:
        return resampled_frames(info.times_s, fps)
    except ValueError as error:
        raise _unreadable(name, str(error)) from error


def _probe(container: av.container.InputContainer, stream: av.VideoStream, name: str) -> Probe:
    found = [(_time(p), p.dts, p.is_keyframe) for p in packets(container, stream) if _time(p) is not None and not p.is_discard]
    rate = stream.average_rate or stream.guessed_rate
    if not found or not stream.time_base or not rate or rate < 0:
        raise _unreadable(name, "no frames" if not found else "no frame rate")
    pts, keys = np.array([time for time, _, _ in found], np.int64), np.array([key for _, _, key in found], bool)
    truncated = _ends_early(container, stream, len(pts), float((pts.max() - pts.min()) * stream.time_base + 1 / rate))
    in_order_until = found[-1][1] if truncated and found[-1][1] is not None else pts.max()
    order = np.argsort(pts, kind="stable")
    order = order[pts[order] <= max(in_order_until, pts.min())]
    return Probe(float(rate), pts[order], float(stream.time_base), keys[order], truncated,
                 (stream.codec_context.width, stream.codec_context.height))


def _ends_early(container: av.container.InputContainer, stream: av.VideoStream, count: int, length_s: float) -> bool:
    if stream.frames:
        return stream.frames > count + 1
    stated_s = (container.duration or 0) / av.time_base
    return stated_s > length_s + LATE_S


def _time(packet: av.Packet) -> int | None:
    return packet.pts if packet.pts is not None else packet.dts


def packets(container: av.container.InputContainer, stream: av.VideoStream) -> Iterator[av.Packet]:
    """Yield packets up to the end of the file, or to the end of the data of a truncated file."""
    found = container.demux(stream)
    while True:
        try:
            packet = next(found)
        except (StopIteration, av.error.FFmpegError):
            return
        yield packet
