"""Topics and their messages: names, channels, payloads stamped with media time."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from mcap_protobuf.schema import build_file_descriptor_set

from afford.recording.content import EPOCH_NS, Channel, Message
from schemas.masks import Entity
from schemas.video import Frames

CAMERA = "camera"
"""frame_id of every image of a clip: optical centre of the camera, x right, y down, z forward"""
PAPER = "paper"
"""frame_id of plots and sheets, which no camera has seen"""
SECOND_NS = 10**9


def channel(topic: str, message: Any, metadata: Mapping[str, object] | None = None) -> Channel:
    """A channel of a protobuf class; metadata values that are not text are written as JSON."""
    definition = build_file_descriptor_set(message).SerializeToString(deterministic=True)
    texts = {k: v if isinstance(v, str) else json.dumps(v, sort_keys=True) for k, v in (metadata or {}).items()}
    return Channel(topic, message.DESCRIPTOR.full_name, definition, tuple(sorted(texts.items())))


def image_channel(topic: str, **metadata: object) -> Channel:
    """A channel of compressed images."""
    return channel(topic, CompressedImage, metadata)


def stamped(topic: str, time_ns: int, message: Any) -> Message:
    """A message with its timestamps set; time_ns counts from EPOCH_NS on, like log time."""
    for timed in timed_parts(message):
        timed.timestamp.seconds, timed.timestamp.nanos = divmod(time_ns, SECOND_NS)
    return Message(time_ns, topic, message.SerializeToString(deterministic=True))


def timed_parts(message: Any) -> list[Any]:
    """What of a message has a timestamp: itself, or (SceneUpdate, FrameTransforms) the parts of its lists."""
    if "timestamp" in message.DESCRIPTOR.fields_by_name:
        return [message]
    return [part for field in message.DESCRIPTOR.fields for part in getattr(message, field.name)]


def image(topic: str, time_ns: int, data: bytes, kind: str = "png", frame_id: str = CAMERA) -> Message:
    """A compressed image: `kind` is png or jpeg."""
    return stamped(topic, time_ns, CompressedImage(frame_id=frame_id, data=data, format=kind))


def log(topic: str, time_ns: int, text: str, name: str, level: str = "INFO") -> Message:
    """A line of text that every viewer shows; `level` as in foxglove.Log."""
    return stamped(topic, time_ns, Log(level=Log.Level.Value(level), message=text, name=name))


def times_of(frame: np.ndarray, frames: Frames) -> list[int]:
    """Log times of data-set frame numbers (t,); ValueError when one of them was not decoded."""
    known = dict(zip(frames.frame.tolist(), frames.time_ns.tolist(), strict=True))
    missing = [n for n in frame.tolist() if n not in known]
    if missing:
        raise ValueError(f"clip {frames.clip_id}: frame {missing[0]} was not decoded, so it has no time; leave it out")
    return [EPOCH_NS + known[n] for n in frame.tolist()]


def slugs(entities: Iterable[Entity]) -> list[str]:
    """Topic words of entities: lower case, '_' for what topics cannot hold; a number is added where two would be the same."""
    found: list[str] = []
    for entity in entities:
        base = re.sub(r"\W+", "_", entity.entity_id.lower()).strip("_") or "entity"
        word, n = base, 2
        while word in found:
            word, n = f"{base}_{n}", n + 1
        found.append(word)
    return found


def about(entity: Entity) -> dict[str, object]:
    """What a mask topic says of its entity."""
    return {"entity_id": entity.entity_id, "name": entity.name, "class_id": str(entity.class_id), "role": entity.role,
            "side": entity.side, "classes": {"0": "background", "255": entity.entity_id}}  # fmt: skip
