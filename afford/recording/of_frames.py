"""Frames -> /frame_decode/image, /frame_decode/state."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from afford.common.image_files import jpeg
from afford.recording.content import Message, Recording
from afford.recording.own_types import FrameState
from afford.recording.topics import channel, image, image_channel, stamped, times_of
from schemas.video import Frames

IMAGE, STATE = "/frame_decode/image", "/frame_decode/state"


def record(value: Frames, frames: Frames) -> Recording:
    """JPEG of every frame; its mean brightness and how much it differs from the one before (0..255)."""
    return Recording((image_channel(IMAGE), channel(STATE, FrameState)), _messages(value, frames))


def _messages(value: Frames, frames: Frames) -> Iterator[Message]:
    before = value.rgb[:1, ::4, ::4].mean(-1)
    for frame, time_ns, rgb in zip(value.frame.tolist(), times_of(value.frame, frames), value.rgb, strict=True):
        now = rgb[None, ::4, ::4].mean(-1)
        state = FrameState(frame=frame, brightness=float(now.mean()), motion=float(np.abs(now - before).mean()))
        yield image(IMAGE, time_ns, jpeg(rgb), "jpeg")
        yield stamped(STATE, time_ns, state)
        before = now
