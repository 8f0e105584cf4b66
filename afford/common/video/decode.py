"""Frames of a video file by number, upright and at working size."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import av
import numpy as np

from afford.common.video.probe import Probe, frames_at, opened, packets, probe
from afford.common.video.size import shrink

Decoded = tuple[np.ndarray, np.ndarray, np.ndarray]
"""frame numbers (t,) int64, media time (t,) int64 ns, images (t, h, w, 3) uint8 RGB"""


def decode_video(path: Path, first: int, last: int, resample_fps: float | None, box_wh: tuple[int, int]) -> Decoded:
    """Frames `first` to `last` (data-set numbers) as far as they can be decoded; damaged and missing ones are left out.

    Times are those of the file, or those of the constant rate when it is resampled. SourceError when the file cannot be read.
    """
    info = probe(path)
    source = frames_at(info, resample_fps, path.name)
    numbers = np.arange(first, min(last, len(source)) + 1, dtype=np.int64)
    indices = source[numbers - 1]
    images = _images(path, info, info.pts[indices], box_wh)
    kept = np.array([int(info.pts[i]) in images for i in indices], bool)
    numbers, indices = numbers[kept], indices[kept]
    times_s = (numbers - 1) / resample_fps if resample_fps else info.times_s[indices]
    return numbers, np.rint(times_s * 1e9).astype(np.int64), np.array([images[int(info.pts[i])] for i in indices], np.uint8)


def every_nth(path: Path, every: int) -> Iterator[tuple[int, float, np.ndarray]]:
    """(number from 1, media time in s, (h, w, 3) uint8 RGB at the file's own size) of frames 1, 1 + every, ..., one at a time.

    Damaged frames are left out. SourceError when the file cannot be read.
    """
    info = probe(path)
    wanted = {int(info.pts[n]): n for n in range(0, len(info.pts), every)}
    with opened(path) as (container, stream):
        for frame in _frames(container, stream, None):
            time = frame.pts if frame.pts is not None else frame.dts
            n = wanted.get(time) if time is not None else None
            if n is not None and not frame.is_corrupt:
                yield n + 1, float(info.times_s[n]), _upright(frame)


def _images(path: Path, info: Probe, pts: np.ndarray, box_wh: tuple[int, int]) -> dict[int, np.ndarray]:
    """Presentation time -> image, for those of the wanted `pts` that decode.

    Decoding starts at the key frame before them, and again from the start when that does not give them all: some containers
    seek to the wrong place, or lose their clock.
    """
    wanted = set(pts.tolist())
    before = info.pts[info.is_key & (info.pts <= pts[:1])] if wanted else pts
    images = _decode(path, int(before[-1]), wanted, box_wh) if len(before) else {}
    return images if len(images) == len(wanted) else images | _decode(path, None, wanted, box_wh)


def _decode(path: Path, start: int | None, wanted: set[int], box_wh: tuple[int, int]) -> dict[int, np.ndarray]:
    last, images = max(wanted), {}
    with opened(path) as (container, stream):
        for frame in _frames(container, stream, start):
            time = frame.pts if frame.pts is not None else frame.dts
            if time is not None and time in wanted and not frame.is_corrupt:
                images[time] = shrink(_upright(frame), box_wh)
            if time is not None and time >= last:
                break
    return images


def _frames(container: av.container.InputContainer, stream: av.VideoStream, start: int | None) -> Iterator[av.VideoFrame]:
    """Frames in the order in which they are shown, from the key frame at `start` on; broken packets are passed over."""
    if start is not None:
        container.seek(start, stream=stream)
    for packet in packets(container, stream):
        try:
            yield from packet.decode()
        except av.error.InvalidDataError:
            continue


def _upright(frame: av.VideoFrame) -> np.ndarray:
    """RGB (h, w, 3) uint8, turned as the file's display matrix asks."""
    return np.ascontiguousarray(np.rot90(frame.to_ndarray(format="rgb24"), round(frame.rotation / 90) % 4))
