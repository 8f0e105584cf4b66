"""Clip -> /source_read/outlines on the key frames, /source_read/narration where each begins, /source_read/log."""

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

from afford.common.palette import Colour, colours_of
from afford.recording import own_types
from afford.recording.content import EPOCH_NS, Message, Recording
from afford.recording.of_labels import narration_message
from afford.recording.topics import channel, log, stamped
from schemas.masks import Entity
from schemas.video import Annotation, Clip, Frames, KeyFrame

OUTLINES, NARRATION, LOG = "/source_read/outlines", "/source_read/narration", "/source_read/log"
LINE_PX, LETTERS_PX = 2.0, 12.0
Colours = Mapping[str, Colour]


def record(value: Clip, frames: Frames) -> Recording:
    """What came from outside: outlines as annotated, on frames that were decoded; the narrations; what the reader remarked."""
    channels = (channel(OUTLINES, ImageAnnotations), channel(NARRATION, own_types.Narration), channel(LOG, Log))
    messages = [*outlines(value, frames, OUTLINES), *_narrations(value, frames), *_remarks(value, frames)]
    return Recording(channels, sorted(messages, key=attrgetter("time_ns")))


def outlines(clip: Clip, frames: Frames, topic: str) -> Iterator[Message]:
    """The masks of every key frame that was decoded, as lines."""
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
    """A closed line. Foxglove counts from the corner of the first pixel, we from its centre: corners come half a pixel on."""
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
    """Each at its first frame that was decoded, or at the last frame when it begins later."""
    for narration in clip.narrations:
        at = min(int(np.searchsorted(frames.frame, narration.start_frame)), len(frames.frame) - 1)
        time_ns = EPOCH_NS + int(frames.time_ns[at])
        yield stamped(NARRATION, time_ns, narration_message(narration, int(frames.frame[at])))
        yield log(LOG, time_ns, narration.text, narration.narration_id)


def _remarks(clip: Clip, frames: Frames) -> Iterator[Message]:
    for text in clip.warnings:
        yield log(LOG, EPOCH_NS + int(frames.time_ns[0]), text, clip.clip_id, "WARNING")


def _colours(clip: Clip) -> Colours:
    """Name -> RGB, the colours that the masks of the same hands and objects have."""
    sides = {a.name: a.side for key in clip.key_frames for a in key.annotations}
    entities = [Entity(name, name, -1, "hand" if side else "object", side) for name, side in sides.items()]
    return dict(zip(sides, colours_of(entities), strict=True))


def _colour(rgb: Colour) -> Color:
    return Color(r=rgb[0] / 255, g=rgb[1] / 255, b=rgb[2] / 255, a=1.0)


def _stamp(part: PointsAnnotation | TextAnnotation, time_ns: int) -> None:
    part.timestamp.seconds, part.timestamp.nanos = divmod(time_ns, 10**9)
