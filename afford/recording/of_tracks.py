"""Tracks -> per entity a mask and its state below /mask_densify, an overlay of all, and who touches what."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from afford.common.image_files import mask_png, overlay_png
from afford.common.palette import Palette, colours_of
from afford.recording.content import Channel, Message, Recording
from afford.recording.own_types import Contact, MaskState
from afford.recording.topics import about, channel, image, image_channel, slugs, stamped, times_of
from schemas.masks import TrackFlag, Tracks
from schemas.video import Frames

ROOM = "/mask_densify"
OVERLAY, CONTACT = f"{ROOM}/overlay", f"{ROOM}/contact"


def record(value: Tracks, frames: Frames) -> Recording:
    """Masks of 0 and 255, one topic per hand and object; states are metrics of each mask."""
    words = slugs(value.entities)
    colours = colours_of(value.entities)
    shades = {word: list(colour) for word, colour in zip(words, colours, strict=True)}
    channels: list[Channel] = [image_channel(OVERLAY, palette=shades), channel(CONTACT, Contact)]
    for word, entity in zip(words, value.entities, strict=True):
        channels += [image_channel(f"{ROOM}/{word}", **about(entity)), channel(f"{ROOM}/{word}/state", MaskState)]
    return Recording(tuple(channels), _messages(value, frames, words, colours))


def _messages(value: Tracks, frames: Frames, words: list[str], colours: Palette) -> Iterator[Message]:
    for t, time_ns in enumerate(times_of(value.frame, frames)):
        yield image(OVERLAY, time_ns, overlay_png(value.masks[:, t], colours))
        yield stamped(CONTACT, time_ns, _contact(value, t))
        for n, word in enumerate(words):
            yield image(f"{ROOM}/{word}", time_ns, mask_png(value.masks[n, t]))
            yield stamped(f"{ROOM}/{word}/state", time_ns, _state(value, n, t))


def _state(value: Tracks, n: int, t: int) -> MaskState:
    flags = TrackFlag(int(value.flags[n, t]))
    return MaskState(
        frame=int(value.frame[t]), confidence=float(value.confidence[n, t]), area_px=float(np.count_nonzero(value.masks[n, t])),
        visible=TrackFlag.VISIBLE in flags, key=TrackFlag.KEY in flags, entering=TrackFlag.ENTERING in flags,
        leaving=TrackFlag.LEAVING in flags, source_frame=int(value.source_frame[n, t]),
        distance_frames=float(value.distance[n, t]))  # fmt: skip


def _contact(value: Tracks, t: int) -> Contact:
    names = {-1: "none", -2: "unknown"} | {n: entity.entity_id for n, entity in enumerate(value.entities)}
    left, right = (names[int(n)] for n in value.contact[:, t])
    since = value.contact_distance[:, t]
    return Contact(frame=int(value.frame[t]), left=left, right=right, left_distance_frames=float(since[0]),
                   right_distance_frames=float(since[1]))  # fmt: skip
