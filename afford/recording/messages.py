"""Topics and messages: channels, payloads stamped with media time, and our protobuf messages of package affordance.v1.

Our messages are built from the table below. Values for plots are flat doubles.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf import descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from mcap_protobuf.schema import build_file_descriptor_set

from afford.recording.mcap_files import EPOCH_NS, Channel, Message
from schemas.hand import FINGERS
from schemas.interaction import AFFORDANCES
from schemas.masks import Entity
from schemas.video import Frames

PACKAGE = "affordance.v1"
PROTO_FILE = "affordance/v1/affordance.proto"
TYPES = {
    "double": FieldDescriptorProto.TYPE_DOUBLE,
    "int64": FieldDescriptorProto.TYPE_INT64,
    "string": FieldDescriptorProto.TYPE_STRING,
    "bool": FieldDescriptorProto.TYPE_BOOL,
}
PRESSING = (*FINGERS, "rest")
"""sources of force: fingers, and the rest of the hand"""
MESSAGES = {
    "FrameState": {"frame": "int64", "brightness": "double", "motion": "double"},
    "MaskState": {"frame": "int64", "confidence": "double", "area_px": "double", "visible": "bool", "key": "bool",
                  "entering": "bool", "leaving": "bool", "source_frame": "int64", "distance_frames": "double"},
    "Contact": {"frame": "int64", "left": "string", "right": "string", "left_distance_frames": "double",
                "right_distance_frames": "double"},
    "HandState": {"frame": "int64", "seen": "bool", "confidence": "double", "palm_m": "double",
                  **{f"{one}_contact": "double" for one in FINGERS}},
    "InpaintState": {"frame": "int64", "replaced_px": "double", "confidence": "double", "background_px": "double",
                     "object_px": "double", "spatial_px": "double"},
    "CompleteState": {"frame": "int64", "confidence": "double", "area_px": "double"},
    "AffordanceState": {"frame": "int64", "accepted": "bool", "rejection": "string", "taxonomy": "string",
                        "taxonomy_id": "int64", "taxonomy3_id": "int64", "quality": "double", "left_object": "string",
                        "right_object": "string", "left_area_px": "double", "right_area_px": "double"},
    "Narration": {"frame": "int64", "narration_id": "string", "text": "string", "verb": "string", "noun": "string",
                  "verb_key": "string", "noun_key": "string", "verb_class": "int64", "noun_class": "int64",
                  "start_frame": "int64", "stop_frame": "int64"},
    "SampleState": {"frame": "int64", "sample_id": "string", "text": "string", "taxonomy_id": "int64", "quality": "double",
                    "inpaint_confidence": "double", "key_distance_frames": "double", "object_left": "string",
                    "object_right": "string"},
    "Document": {"name": "string", "media_type": "string", "text": "string"},
    "Scalar": {"step": "int64", "value": "double"},
    "GraspState": {"step": "int64", "goal_m": "double", "height_m": "double", "success": "bool", "as_violation_pct": "double",
                   "as_safe_count": "double", "penetration_mm": "double", "reward": "double"},
    "GraspForce": {"step": "int64", **{f"{one}{what}_n": "double" for what in ("", "_negative") for one in PRESSING}},
    "ActionState": {"step": "int64", "said": "string", **dict.fromkeys(AFFORDANCES, "double")},
}  # fmt: skip
"""message -> field -> type, after the field `timestamp`, the first of every message"""


def _proto_file() -> FileDescriptorProto:
    file = FileDescriptorProto(name=PROTO_FILE, package=PACKAGE, syntax="proto3", dependency=[timestamp_pb2.DESCRIPTOR.name])
    for name, fields in MESSAGES.items():
        message = file.message_type.add(name=name)
        message.field.add(name="timestamp", number=1, label=FieldDescriptorProto.LABEL_OPTIONAL,
                          type=FieldDescriptorProto.TYPE_MESSAGE, type_name=".google.protobuf.Timestamp")  # fmt: skip
        for number, (field, kind) in enumerate(fields.items(), 2):
            message.field.add(name=field, number=number, label=FieldDescriptorProto.LABEL_OPTIONAL, type=TYPES[kind])
    return file


descriptor_pool.Default().AddSerializedFile(_proto_file().SerializeToString(deterministic=True))


def message_class(name: str) -> Any:
    """Class of a message of `MESSAGES`."""
    return message_factory.GetMessageClass(descriptor_pool.Default().FindMessageTypeByName(f"{PACKAGE}.{name}"))


FrameState, MaskState, Contact = message_class("FrameState"), message_class("MaskState"), message_class("Contact")
HandState, InpaintState = message_class("HandState"), message_class("InpaintState")
CompleteState, AffordanceState = message_class("CompleteState"), message_class("AffordanceState")
NarrationState, SampleState, Document = message_class("Narration"), message_class("SampleState"), message_class("Document")
Scalar = message_class("Scalar")
GraspState, GraspForce = message_class("GraspState"), message_class("GraspForce")
ActionState = message_class("ActionState")


CAMERA = "camera"
"""frame_id of every image of a clip: optical centre of the camera, x right, y down, z forward"""
PAPER = "paper"
"""frame_id of plots and sheets, which have no camera"""
SECOND_NS = 10**9


def channel(topic: str, message: Any, metadata: Mapping[str, object] | None = None) -> Channel:
    """Channel of a protobuf class; metadata values that are not strings are written as JSON."""
    definition = build_file_descriptor_set(message).SerializeToString(deterministic=True)
    texts = {k: v if isinstance(v, str) else json.dumps(v, sort_keys=True) for k, v in (metadata or {}).items()}
    return Channel(topic, message.DESCRIPTOR.full_name, definition, tuple(sorted(texts.items())))


def image_channel(topic: str, **metadata: object) -> Channel:
    """Channel of compressed images."""
    return channel(topic, CompressedImage, metadata)


def stamped(topic: str, time_ns: int, message: Any) -> Message:
    """Message with its timestamps set; time_ns counts from EPOCH_NS, like log time."""
    for timed in timed_parts(message):
        timed.timestamp.seconds, timed.timestamp.nanos = divmod(time_ns, SECOND_NS)
    return Message(time_ns, topic, message.SerializeToString(deterministic=True))


def timed_parts(message: Any) -> list[Any]:
    """Parts of a message that have a timestamp: itself, or (SceneUpdate, FrameTransforms) the items of its lists."""
    if "timestamp" in message.DESCRIPTOR.fields_by_name:
        return [message]
    return [part for field in message.DESCRIPTOR.fields for part in getattr(message, field.name)]


def image(topic: str, time_ns: int, data: bytes, kind: str = "png", frame_id: str = CAMERA) -> Message:
    """Compressed image; `kind` is png or jpeg."""
    return stamped(topic, time_ns, CompressedImage(frame_id=frame_id, data=data, format=kind))


def log(topic: str, time_ns: int, text: str, name: str, level: str = "INFO") -> Message:
    """Log line, which every viewer shows; `level` as in foxglove.Log."""
    return stamped(topic, time_ns, Log(level=Log.Level.Value(level), message=text, name=name))


def times_of(frame: np.ndarray, frames: Frames) -> list[int]:
    """Log times of data-set frame numbers (t,); ValueError when one of them was not decoded."""
    known = dict(zip(frames.frame.tolist(), frames.time_ns.tolist(), strict=True))
    missing = [n for n in frame.tolist() if n not in known]
    if missing:
        raise ValueError(f"clip {frames.clip_id}: frame {missing[0]} was not decoded, so it has no time; leave it out")
    return [EPOCH_NS + known[n] for n in frame.tolist()]


def slugs(entities: Iterable[Entity]) -> list[str]:
    """Topic words of entities: lower case, '_' for characters that topics cannot hold, a number for duplicates."""
    found: list[str] = []
    for entity in entities:
        base = re.sub(r"\W+", "_", entity.entity_id.lower()).strip("_") or "entity"
        word, n = base, 2
        while word in found:
            word, n = f"{base}_{n}", n + 1
        found.append(word)
    return found


def about(entity: Entity) -> dict[str, object]:
    """Metadata of a mask topic about its entity."""
    return {"entity_id": entity.entity_id, "name": entity.name, "class_id": str(entity.class_id), "role": entity.role,
            "side": entity.side, "classes": {"0": "background", "255": entity.entity_id}}  # fmt: skip
