"""Lossless video codec: x264 RGB at qp 0 in Matroska, single-threaded, bit-exact and deterministic.

Compared with FFV1 on noisy 456 x 256 frames, writing takes half the time, reading two thirds, at the same size.
"""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np

RATE = 30
"""nominal frame rate; the time of a frame is in the schema, not in the file"""
OPTIONS = {"qp": "0", "preset": "ultrafast"}


def write_video(path: Path, rgb: np.ndarray) -> None:
    """Write frames (t, h, w, 3) uint8, t >= 1."""
    with av.open(str(path), "w", format="matroska", container_options={"fflags": "+bitexact"}) as out:
        stream = out.add_stream("libx264rgb", rate=RATE, options=OPTIONS)
        stream.width, stream.height, stream.pix_fmt = rgb.shape[2], rgb.shape[1], "bgr0"
        stream.codec_context.thread_count = 1
        stream.codec_context.flags |= 1 << 23  # AV_CODEC_FLAG_BITEXACT: no library version in the stream
        for image in rgb:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
            out.mux(stream.encode(frame.reformat(format="bgr0")))
        out.mux(stream.encode(None))


def read_video(path: Path, shape: tuple[int, ...]) -> np.ndarray:
    """Read the frames (t, h, w, 3) uint8 of a file of `write_video`. Raises ValueError when there are fewer."""
    rgb = np.zeros(shape, np.uint8)
    count = 0
    with av.open(str(path)) as container:
        container.streams.video[0].codec_context.thread_count = 1
        for frame in container.decode(video=0):
            rgb[count] = frame.to_ndarray(format="rgb24")
            count += 1
    if count != shape[0]:
        raise ValueError(f"{path.name}: expected {shape[0]} frames, got {count}")
    return rgb
