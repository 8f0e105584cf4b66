"""CompleteObjects -> per object its complete mask and state below /object_completion, and an overlay."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from afford.common.image_files import mask_png, overlay_png
from afford.common.palette import Palette, colours_of
from afford.recording.content import Channel, Message, Recording
from afford.recording.own_types import CompleteState
from afford.recording.topics import about, channel, image, image_channel, slugs, stamped, times_of
from schemas.masks import CompleteObjects
from schemas.video import Frames

ROOM = "/object_completion"
OVERLAY = f"{ROOM}/overlay"


def record(value: CompleteObjects, frames: Frames) -> Recording:
    """Masks of 0 and 255, one topic per object that a hand touches."""
    words = slugs(value.entities)
    colours = colours_of(value.entities)
    shades = {word: list(colour) for word, colour in zip(words, colours, strict=True)}
    channels: list[Channel] = [image_channel(OVERLAY, palette=shades)]
    for word, entity in zip(words, value.entities, strict=True):
        channels += [image_channel(f"{ROOM}/{word}", **about(entity)), channel(f"{ROOM}/{word}/state", CompleteState)]
    return Recording(tuple(channels), _messages(value, frames, words, colours))


def _messages(value: CompleteObjects, frames: Frames, words: list[str], colours: Palette) -> Iterator[Message]:
    for t, time_ns in enumerate(times_of(value.frame, frames)):
        yield image(OVERLAY, time_ns, overlay_png(value.masks[:, t], colours))
        for n, word in enumerate(words):
            state = CompleteState(frame=int(value.frame[t]), confidence=float(value.confidence[n, t]),
                                  area_px=float(np.count_nonzero(value.masks[n, t])))  # fmt: skip
            yield image(f"{ROOM}/{word}", time_ns, mask_png(value.masks[n, t]))
            yield stamped(f"{ROOM}/{word}/state", time_ns, state)
