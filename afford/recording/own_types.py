"""Our own protobuf messages, package affordance.v1, built from the tables below. Numbers to be plotted are flat doubles."""

from __future__ import annotations

from typing import Any

from google.protobuf import descriptor_pool, message_factory, timestamp_pb2
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto

from schemas.hand import FINGERS
from schemas.interaction import AFFORDANCES

PACKAGE = "affordance.v1"
FILE = "affordance/v1/affordance.proto"
TYPES = {
    "double": FieldDescriptorProto.TYPE_DOUBLE,
    "int64": FieldDescriptorProto.TYPE_INT64,
    "string": FieldDescriptorProto.TYPE_STRING,
    "bool": FieldDescriptorProto.TYPE_BOOL,
}
PRESSING = (*FINGERS, "rest")
"""what of a hand presses: fingers, and the rest of it"""
MESSAGES = {
    "FrameState": {"frame": "int64", "brightness": "double", "motion": "double"},
    "MaskState": {"frame": "int64", "confidence": "double", "area_px": "double", "visible": "bool", "key": "bool",
                  "entering": "bool", "leaving": "bool", "source_frame": "int64", "distance_frames": "double"},
    "Contact": {"frame": "int64", "left": "string", "right": "string", "left_distance_frames": "double",
                "right_distance_frames": "double"},
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
"""message -> field -> type, after the field `timestamp` that every message begins with"""


def _file() -> FileDescriptorProto:
    file = FileDescriptorProto(name=FILE, package=PACKAGE, syntax="proto3", dependency=[timestamp_pb2.DESCRIPTOR.name])
    for name, fields in MESSAGES.items():
        message = file.message_type.add(name=name)
        message.field.add(name="timestamp", number=1, label=FieldDescriptorProto.LABEL_OPTIONAL,
                          type=FieldDescriptorProto.TYPE_MESSAGE, type_name=".google.protobuf.Timestamp")  # fmt: skip
        for number, (field, kind) in enumerate(fields.items(), 2):
            message.field.add(name=field, number=number, label=FieldDescriptorProto.LABEL_OPTIONAL, type=TYPES[kind])
    return file


descriptor_pool.Default().AddSerializedFile(_file().SerializeToString(deterministic=True))


def own(name: str) -> Any:
    """The class of a message of `MESSAGES`."""
    return message_factory.GetMessageClass(descriptor_pool.Default().FindMessageTypeByName(f"{PACKAGE}.{name}"))


FrameState, MaskState, Contact, InpaintState = own("FrameState"), own("MaskState"), own("Contact"), own("InpaintState")
CompleteState, AffordanceState = own("CompleteState"), own("AffordanceState")
Narration, SampleState, Document = own("Narration"), own("SampleState"), own("Document")
Scalar = own("Scalar")
GraspState, GraspForce = own("GraspState"), own("GraspForce")
ActionState = own("ActionState")
