"""FrameLabels -> /narration on every labelled frame, /narration/log where a narration begins."""

from __future__ import annotations

from collections.abc import Iterator

from foxglove_schemas_protobuf.Log_pb2 import Log

from afford.recording import own_types
from afford.recording.content import Message, Recording
from afford.recording.topics import channel, log, stamped, times_of
from schemas.affordance import FrameLabels
from schemas.video import Frames, Narration

NARRATION, LOG = "/narration", "/narration/log"


def record(value: FrameLabels, frames: Frames) -> Recording:
    """The task of every frame as a message of our own, and as a line of text that every viewer shows."""
    return Recording((channel(NARRATION, own_types.Narration), channel(LOG, Log)), _messages(value, frames))


def _messages(value: FrameLabels, frames: Frames) -> Iterator[Message]:
    begun: set[int] = set()
    times = times_of(value.frame, frames)
    for frame, time_ns, index in zip(value.frame.tolist(), times, value.narration.tolist(), strict=True):
        narration = value.narrations[index]
        yield stamped(NARRATION, time_ns, narration_message(narration, frame))
        if index not in begun:
            yield log(LOG, time_ns, narration.text, narration.narration_id)
        begun.add(index)


def narration_message(n: Narration, frame: int) -> own_types.Narration:
    """A narration, as said of a frame."""
    return own_types.Narration(
        frame=frame, narration_id=n.narration_id, text=n.text, verb=n.verb, noun=n.noun, verb_key=n.verb_key,
        noun_key=n.noun_key, verb_class=n.verb_class, noun_class=n.noun_class, start_frame=n.start_frame,
        stop_frame=n.stop_frame)  # fmt: skip
