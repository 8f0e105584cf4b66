"""Recorder of the hands detected in a clip: outlines of key frames, keypoints in the picture and in space, contact of fingers."""

from __future__ import annotations

from collections.abc import Iterator
from operator import attrgetter
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from afford.common.palette import HANDS
from afford.recording.extraction_sources import outlines
from afford.recording.mcap_files import Message, Recording
from afford.recording.messages import CAMERA, HandState, channel, stamped, times_of
from afford.recording.spatial import entity, loop, scene
from schemas.hand import FINGERS
from schemas.hands import DetectedHands, HandTracks
from schemas.video import SIDES, Frames

DETECTED_OUTLINES, KEYPOINTS, HAND_BONES = "/hand_detect/outlines", "/hand_detect/keypoints", "/hand_detect/bones"
FINGER_CHAINS = tuple((0, *range(first, first + 4)) for first in (1, 5, 9, 13, 17))
"""keypoints from the wrist to each fingertip, thumb first"""
PALM = [0, 5, 9, 13, 17]
FAINTEST, BONE_PX, POINT_PX, TOUCH_PX = 0.25, 1.5, 4.0, 8.0
"""opacity of a keypoint of confidence 0; thickness of lines, keypoints and touching fingertips"""
TOUCHES = 0.5
"""probability from which a fingertip is drawn as touching"""
WHITE = (255, 255, 255)


def record_detections(value: DetectedHands, frames: Frames) -> Recording:
    """Outlines of detected hands and the objects they touch; keypoints of both hands, as confident as they are opaque.

    DetectedHands -> /hand_detect/outlines, /hand_detect/keypoints, /hand_detect/bones, /hand_detect/left, /hand_detect/right.
    """
    channels = [channel(DETECTED_OUTLINES, ImageAnnotations), channel(KEYPOINTS, ImageAnnotations),
                channel(HAND_BONES, SceneUpdate), *(channel(f"/hand_detect/{side}", HandState) for side in SIDES)]  # fmt: skip
    messages = [*outlines(value.clip, frames, DETECTED_OUTLINES), *_keypoint_messages(value.hands, frames)]
    return Recording(tuple(channels), sorted(messages, key=attrgetter("time_ns")))


def _keypoint_messages(hands: HandTracks, frames: Frames) -> Iterator[Message]:
    scale = np.array([frames.rgb.shape[2] / hands.width_px, frames.rgb.shape[1] / hands.height_px])
    for t, time_ns in enumerate(times_of(hands.frame, frames)):
        shown = [n for n in range(len(SIDES)) if hands.confidence[n, t].any()]
        yield stamped(KEYPOINTS, time_ns, _annotations(hands, t, shown, scale, time_ns))
        yield scene(HAND_BONES, time_ns, [
            entity(SIDES[n], CAMERA, lines=[loop(hands.keypoints_m[n, t, list(chain)], HANDS[SIDES[n]], False)
                                            for chain in FINGER_CHAINS if n in shown]) for n in range(len(SIDES))])  # fmt: skip
        for n, side in enumerate(SIDES):
            yield stamped(f"/hand_detect/{side}", time_ns, _state(hands, n, t))


def _annotations(hands: HandTracks, t: int, shown: list[int], scale: np.ndarray, time_ns: int) -> ImageAnnotations:
    """Lines and points of the shown hands, shifted by half a pixel: Foxglove counts from the corner of the first pixel."""
    drawn = ImageAnnotations()
    for n in shown:
        at, sure = (hands.keypoints_px[n, t] + 0.5) * scale, hands.confidence[n, t]
        colours = [_colour(HANDS[SIDES[n]], FAINTEST + (1 - FAINTEST) * float(one)) for one in sure]
        for chain in FINGER_CHAINS:
            faint = _colour(HANDS[SIDES[n]], FAINTEST + (1 - FAINTEST) * float(sure[list(chain)].min()))
            drawn.points.append(_points("LINE_STRIP", at[list(chain)], BONE_PX, outline_color=faint))
        drawn.points.append(_points("POINTS", at, POINT_PX, outline_colors=colours))
        tips = at[4::4][hands.finger_contact[n, t] >= TOUCHES]
        if len(tips):
            drawn.points.append(_points("POINTS", tips, TOUCH_PX, outline_colors=[_colour(WHITE, 1.0)] * len(tips)))
    for part in drawn.points:
        part.timestamp.seconds, part.timestamp.nanos = divmod(time_ns, 10**9)
    return drawn


def _points(kind: str, at: np.ndarray, thickness_px: float, **colours: Any) -> PointsAnnotation:
    return PointsAnnotation(type=PointsAnnotation.Type.Value(kind), thickness=thickness_px,
                            points=[Point2(x=x, y=y) for x, y in at.tolist()], **colours)  # fmt: skip


def _state(hands: HandTracks, n: int, t: int) -> HandState:
    """Confidence of a hand, distance of its palm from the camera, and contact of its fingers."""
    contact = {f"{name}_contact": float(one) for name, one in zip(FINGERS, hands.finger_contact[n, t], strict=True)}
    return HandState(frame=int(hands.frame[t]), seen=bool(hands.seen[n, t]), confidence=float(hands.confidence[n, t].mean()),
                     palm_m=float(hands.keypoints_m[n, t, PALM, 2].mean()), **contact)  # fmt: skip


def _colour(rgb: tuple[int, int, int], opacity: float) -> Color:
    return Color(r=rgb[0] / 255, g=rgb[1] / 255, b=rgb[2] / 255, a=opacity)
