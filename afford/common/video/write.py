"""Pictures -> a video file: H.264 in MP4."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

X264 = {"preset": "medium", "x264-params": "threads=1:mbtree=0"}
"""Macroblock-tree rate control is off: with it the same frames gave different bytes (measured, x264 core 165 on AVX-512)."""


def write_video(path: Path, images: Iterable[np.ndarray], crf: int, rate_hz: int = 30) -> None:
    """(h, w, 3) uint8 RGB images of one size, both even; one thread, so that the same images give the same bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w", format="mp4", container_options={"fflags": "+bitexact"}) as container:
        stream = container.add_stream("libx264", rate=rate_hz, options={"crf": str(crf), **X264})
        stream.pix_fmt = "yuv420p"
        stream.thread_count = 1
        stream.codec_context.time_base = Fraction(1, rate_hz)
        for number, image in enumerate(images):
            if not number:
                stream.height, stream.width = image.shape[:2]
            picture = av.VideoFrame.from_ndarray(image, format="rgb24")
            picture.pts = number
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
