"""What a video file holds, from its packets alone: nothing is decoded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np

LATE_S = 0.25
"""a video that ends this much before its container says so was cut short"""


@dataclass(frozen=True)
class Probe:
    """The frames of a video in the order in which they are shown."""

    fps: float
    """average rate that the container states, 1/s"""
    pts: np.ndarray
    """(n,) int64 presentation times in `time_base_s`, ascending"""
    time_base_s: float
    is_key: np.ndarray
    """(n,) bool: decoding may start here"""
    truncated: bool
    """the file ends before the container says so; the last frames, whose order is in doubt, are not counted"""

    @property
    def times_s(self) -> np.ndarray:
        """(n,) float64 seconds since the first frame."""
        return (self.pts - self.pts[0]) * self.time_base_s


def probe(path: Path) -> Probe:
    """Read the packets of the first video stream. ValueError when there is none, or when no packet can be read."""
    try:
        with av.open(str(path)) as container:
            if not container.streams.video:
                raise ValueError("no video stream")
            return _probe(container)
    except av.error.FFmpegError as error:
        raise ValueError(error.strerror or "unreadable data") from error


def _probe(container: av.container.InputContainer) -> Probe:
    stream = container.streams.video[0]
    found = [(_time(p), p.dts, p.is_keyframe) for p in packets(container, stream) if _time(p) is not None and not p.is_discard]
    rate = stream.average_rate or stream.guessed_rate
    if not found or stream.time_base is None or not rate:
        raise ValueError("no frames" if not found else "no frame rate")
    pts, keys = np.array([time for time, _, _ in found], np.int64), np.array([key for _, _, key in found], bool)
    truncated = _ends_early(container, stream, len(pts), float((pts.max() - pts.min()) * stream.time_base + 1 / rate))
    in_order_until = found[-1][1] if truncated and found[-1][1] is not None else pts.max()
    order = np.argsort(pts, kind="stable")
    order = order[pts[order] <= max(in_order_until, pts.min())]
    return Probe(float(rate), pts[order], float(stream.time_base), keys[order], truncated)


def _ends_early(container: av.container.InputContainer, stream: av.VideoStream, count: int, length_s: float) -> bool:
    if stream.frames:
        return stream.frames > count + 1
    stated_s = (container.duration or 0) / av.time_base
    return stated_s > length_s + LATE_S


def _time(packet: av.Packet) -> int | None:
    return packet.pts if packet.pts is not None else packet.dts


def packets(container: av.container.InputContainer, stream: av.VideoStream) -> Iterator[av.Packet]:
    """Its packets up to the end, or to where the data of a truncated file end."""
    found = container.demux(stream)
    while True:
        try:
            packet = next(found)
        except (StopIteration, av.error.FFmpegError):
            return
        yield packet
