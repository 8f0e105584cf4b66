"""Recorders of extraction inputs: frames, annotated outlines, narrations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from operator import attrgetter

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from foxglove_schemas_protobuf.TextAnnotation_pb2 import TextAnnotation

from afford.common.image_files import jpeg
from afford.common.palette import Colour, colours_of
from afford.recording.mcap_files import EPOCH_NS, Message, Recording
from afford.recording.messages import FrameState, NarrationState, channel, image, image_channel, log, stamped, times_of
from schemas.affordance import FrameLabels
from schemas.masks import Entity
from schemas.video import Annotation, Clip, Frames, KeyFrame, Narration

FRAME_IMAGE, FRAME_STATE = "/frame_decode/image", "/frame_decode/state"


def record_frames(value: Frames, frames: Frames) -> Recording:
    """JPEG of every frame with its mean brightness and its difference from the frame before (0..255).

    Frames -> /frame_decode/image, /frame_decode/state.
    """
    return Recording((image_channel(FRAME_IMAGE), channel(FRAME_STATE, FrameState)), _frame_messages(value, frames))


def _frame_messages(value: Frames, frames: Frames) -> Iterator[Message]:
    before = value.rgb[:1, ::4, ::4].mean(-1)
    for frame, time_ns, rgb in zip(value.frame.tolist(), times_of(value.frame, frames), value.rgb, strict=True):
        now = rgb[None, ::4, ::4].mean(-1)
        state = FrameState(frame=frame, brightness=float(now.mean()), motion=float(np.abs(now - before).mean()))
        yield image(FRAME_IMAGE, time_ns, jpeg(rgb), "jpeg")
        yield stamped(FRAME_STATE, time_ns, state)
        before = now


CLIP_OUTLINES, CLIP_NARRATION, CLIP_LOG = "/source_read/outlines", "/source_read/narration", "/source_read/log"
LINE_PX, LETTERS_PX = 2.0, 12.0
Colours = Mapping[str, Colour]


def record_clip(value: Clip, frames: Frames) -> Recording:
    """Outlines as annotated on decoded key frames, narrations, and warnings of the reader.

    Clip -> /source_read/outlines, /source_read/narration where each begins, /source_read/log.
    """
    channels = (channel(CLIP_OUTLINES, ImageAnnotations), channel(CLIP_NARRATION, NarrationState), channel(CLIP_LOG, Log))
    messages = [*outlines(value, frames, CLIP_OUTLINES), *_narrations(value, frames), *_remarks(value, frames)]
    return Recording(channels, sorted(messages, key=attrgetter("time_ns")))


def outlines(clip: Clip, frames: Frames, topic: str) -> Iterator[Message]:
    """Masks of every decoded key frame as closed lines with names."""
    times = dict(zip(frames.frame.tolist(), frames.time_ns.tolist(), strict=True))
    colours, size = _colours(clip), frames.rgb.shape[1:3]
    for key in clip.key_frames:
        if key.frame in times:
            yield stamped(topic, EPOCH_NS + times[key.frame], _drawn(key, size, EPOCH_NS + times[key.frame], colours))


def _drawn(key: KeyFrame, size_hw: tuple[int, ...], time_ns: int, colours: Colours) -> ImageAnnotations:
    scale = np.array([size_hw[1] / key.width_px, size_hw[0] / key.height_px])
    drawn = ImageAnnotations()
    for annotation in key.annotations:
        loops = [(polygon.points + 0.5) * scale for polygon in annotation.polygons if len(polygon.points)]
        for corners in loops:
            _draw(drawn, annotation, corners, time_ns, colours)
        if loops:
            _name(drawn, annotation, loops[0], time_ns, colours)
    return drawn


def _draw(drawn: ImageAnnotations, annotation: Annotation, corners: np.ndarray, time_ns: int, colours: Colours) -> None:
    """Add a closed line, shifted by half a pixel: Foxglove counts from the corner of the first pixel, we from its centre."""
    line = PointsAnnotation(type=PointsAnnotation.LINE_LOOP, thickness=LINE_PX, outline_color=_colour(colours[annotation.name]),
                            points=[Point2(x=x, y=y) for x, y in corners.tolist()])  # fmt: skip
    _stamp(line, time_ns)
    drawn.points.append(line)


def _name(drawn: ImageAnnotations, annotation: Annotation, corners: np.ndarray, time_ns: int, colours: Colours) -> None:
    x, y = corners[corners[:, 1].argmin()].tolist()
    text = TextAnnotation(position=Point2(x=x, y=y), text=annotation.name, font_size=LETTERS_PX,
                          text_color=_colour(colours[annotation.name]), background_color=Color(a=0.6))  # fmt: skip
    _stamp(text, time_ns)
    drawn.texts.append(text)


def _narrations(clip: Clip, frames: Frames) -> Iterator[Message]:
    """Narrations, each at its first decoded frame, or at the last frame when it begins later."""
    for narration in clip.narrations:
        at = min(int(np.searchsorted(frames.frame, narration.start_frame)), len(frames.frame) - 1)
        time_ns = EPOCH_NS + int(frames.time_ns[at])
        yield stamped(CLIP_NARRATION, time_ns, narration_message(narration, int(frames.frame[at])))
        yield log(CLIP_LOG, time_ns, narration.text, narration.narration_id)


def _remarks(clip: Clip, frames: Frames) -> Iterator[Message]:
    for text in clip.warnings:
        yield log(CLIP_LOG, EPOCH_NS + int(frames.time_ns[0]), text, clip.clip_id, "WARNING")


def _colours(clip: Clip) -> Colours:
    """Colour of each name: RGB of the masks of the same hands and objects."""
    sides = {a.name: a.side for key in clip.key_frames for a in key.annotations}
    entities = [Entity(name, name, -1, "hand" if side else "object", side) for name, side in sides.items()]
    return dict(zip(sides, colours_of(entities), strict=True))


def _colour(rgb: Colour) -> Color:
    return Color(r=rgb[0] / 255, g=rgb[1] / 255, b=rgb[2] / 255, a=1.0)


def _stamp(part: PointsAnnotation | TextAnnotation, time_ns: int) -> None:
    part.timestamp.seconds, part.timestamp.nanos = divmod(time_ns, 10**9)


NARRATION, NARRATION_LOG = "/narration", "/narration/log"


def record_narrations(value: FrameLabels, frames: Frames) -> Recording:
    """Task of every frame as a message of our own and, where a narration begins, as a log line.

    FrameLabels -> /narration on every labelled frame, /narration/log.
    """
    return Recording((channel(NARRATION, NarrationState), channel(NARRATION_LOG, Log)), _narration_messages(value, frames))


def _narration_messages(value: FrameLabels, frames: Frames) -> Iterator[Message]:
    begun: set[int] = set()
    times = times_of(value.frame, frames)
    for frame, time_ns, index in zip(value.frame.tolist(), times, value.narration.tolist(), strict=True):
        narration = value.narrations[index]
        yield stamped(NARRATION, time_ns, narration_message(narration, frame))
        if index not in begun:
            yield log(NARRATION_LOG, time_ns, narration.text, narration.narration_id)
        begun.add(index)


def narration_message(n: Narration, frame: int) -> NarrationState:
    """Narration of a frame."""
    return NarrationState(
        frame=frame, narration_id=n.narration_id, text=n.text, verb=n.verb, noun=n.noun, verb_key=n.verb_key,
        noun_key=n.noun_key, verb_class=n.verb_class, noun_class=n.noun_class, start_frame=n.start_frame,
        stop_frame=n.stop_frame)  # fmt: skip
