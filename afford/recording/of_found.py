"""Clip whose key frames were found here -> /hand_detect/outlines."""

from __future__ import annotations

from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations

from afford.recording.content import Recording
from afford.recording.of_clip import outlines
from afford.recording.topics import channel
from schemas.video import Clip, Frames

OUTLINES = "/hand_detect/outlines"


def record(value: Clip, frames: Frames) -> Recording:
    """Hands and what they touch, as they were found."""
    return Recording((channel(OUTLINES, ImageAnnotations),), list(outlines(value, frames, OUTLINES)))
