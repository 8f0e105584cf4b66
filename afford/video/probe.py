"""What a video file holds, from its packets alone: nothing is decoded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np


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
    declared: int
    """number of frames that the container states, 0 when it does not"""

    @property
    def times_s(self) -> np.ndarray:
        """(n,) float64 seconds since the first frame."""
        return (self.pts - self.pts[0]) * self.time_base_s

    @property
    def truncated(self) -> bool:
        """The container states more frames than the file has data for."""
        return self.declared > len(self.pts) + 1


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
    times, keys = [], []
    for packet in _packets(container, stream):
        time = packet.pts if packet.pts is not None else packet.dts
        if time is not None and not packet.is_discard:
            times.append(time)
            keys.append(packet.is_keyframe)
    if not times or stream.time_base is None:
        raise ValueError("no frames")
    order = np.argsort(times, kind="stable")
    rate = stream.average_rate or stream.guessed_rate
    if not rate:
        raise ValueError("no frame rate")
    pts, is_key = np.array(times, np.int64)[order], np.array(keys, bool)[order]
    return Probe(float(rate), pts, float(stream.time_base), is_key, stream.frames)


def _packets(container: av.container.InputContainer, stream: av.VideoStream) -> Iterator[av.Packet]:
    """Packets up to the end, or to where the data of a truncated file end."""
    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets)
        except (StopIteration, av.error.FFmpegError):
            return
        yield packet
