"""Inpainted -> /hand_inpaint/image, mask, confidence, source, state."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from afford.common.image_files import colour_png, grey_png, jpeg, mask_png
from afford.recording.content import Message, Recording
from afford.recording.own_types import InpaintState
from afford.recording.topics import channel, image, image_channel, stamped, times_of
from schemas.video import Frames, Inpainted, PixelSource

ROOM = "/hand_inpaint"
COLOURS = ((0, 0, 0), (102, 187, 106), (255, 202, 40), (239, 83, 80))
"""PixelSource in order: original, background, object, spatial"""


def record(value: Inpainted, frames: Frames) -> Recording:
    """The frame without hands; what was replaced, where each pixel came from, and how sure it is."""
    colours = {source.name.lower(): list(COLOURS[source]) for source in PixelSource}
    channels = (
        image_channel(f"{ROOM}/image"),
        image_channel(f"{ROOM}/mask", classes={"0": "kept", "255": "replaced"}),
        image_channel(f"{ROOM}/confidence", classes={"0": "guessed", "255": "seen"}),
        image_channel(f"{ROOM}/source", palette=colours),
        channel(f"{ROOM}/state", InpaintState),
    )
    return Recording(channels, _messages(value, frames))


def _messages(value: Inpainted, frames: Frames) -> Iterator[Message]:
    for t, time_ns in enumerate(times_of(value.frame, frames)):
        yield image(f"{ROOM}/image", time_ns, jpeg(value.rgb[t]), "jpeg")
        yield image(f"{ROOM}/mask", time_ns, mask_png(value.mask[t]))
        yield image(f"{ROOM}/confidence", time_ns, grey_png(value.confidence[t]))
        yield image(f"{ROOM}/source", time_ns, colour_png(value.source[t], COLOURS))
        yield stamped(f"{ROOM}/state", time_ns, _state(value, t))


def _state(value: Inpainted, t: int) -> InpaintState:
    replaced = value.mask[t]
    count = np.bincount(value.source[t][replaced], minlength=len(PixelSource))
    sure = float(value.confidence[t][replaced].mean()) / 255 if replaced.any() else 1.0
    return InpaintState(
        frame=int(value.frame[t]), replaced_px=float(np.count_nonzero(replaced)), confidence=sure,
        background_px=float(count[PixelSource.BACKGROUND]), object_px=float(count[PixelSource.OBJECT]),
        spatial_px=float(count[PixelSource.SPATIAL]))  # fmt: skip
