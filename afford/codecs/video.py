"""Frames to a lossless video file and back: x264 in RGB at qp 0, Matroska, one thread; exact to the bit, the same bytes every time.

Measured against FFV1 on noisy 456 x 256 frames: half the time to write, a third less to read, the same size.
"""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np

RATE = 30
"""nominal; the time of a frame is in the schema, not in the file"""
OPTIONS = {"qp": "0", "preset": "ultrafast"}


def write_video(path: Path, rgb: np.ndarray) -> None:
    """Write (t, h, w, 3) uint8 frames, t >= 1."""
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
    """Read the frames of a file that `write_video` wrote, (t, h, w, 3) uint8; ValueError when there are fewer."""
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
