"""Content check of a recording: every payload parsed, every picture decoded, every frame complete."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap_protobuf.decoder import DecoderFactory

from afford.recording.mcap_files import EPOCH_NS
from afford.recording.messages import CAMERA, timed_parts

FRAMES = "/frame_decode/image"
MAGIC = {"jpeg": b"\xff\xd8\xff", "png": b"\x89PNG\r\n\x1a\n"}
SECOND_NS = 10**9
MAX_PROBLEMS = 20
"""problems reported of one file"""


@dataclass
class Seen:
    """Image times and sizes collected from the messages, and problems."""

    times: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    """image topic -> log times"""
    sizes: dict[tuple[int, int], str] = field(default_factory=dict)
    """(height, width) of camera images -> a topic of that size"""
    problems: list[str] = field(default_factory=list)


def check_content(path: Path) -> list[str]:
    """List at most MAX_PROBLEMS problems of the payloads as sentences; [] without any. The file must be intact."""
    seen = Seen()
    with path.open("rb") as stream:
        for _, channel, message, value in make_reader(stream, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            _payload(channel, message, value, seen)
            if len(seen.problems) >= MAX_PROBLEMS:
                return seen.problems
    return seen.problems + _sizes(seen) + _complete(seen)


def _payload(channel: Channel, message: Message, value: Any, seen: Seen) -> None:
    where = f"{channel.topic} at {(message.log_time - EPOCH_NS) / SECOND_NS:.3f} s"
    stamps = {part.timestamp.seconds * SECOND_NS + part.timestamp.nanos for part in timed_parts(value)}
    if stamps | {message.publish_time} != {message.log_time}:
        seen.problems.append(f"{where}: timestamp, log time and publish time differ")
    if value.DESCRIPTOR.full_name == "foxglove.CompressedImage":
        seen.times[channel.topic].append(message.log_time)
        _picture(channel, value, where, seen)


def _picture(channel: Channel, value: Any, where: str, seen: Seen) -> None:
    if not value.frame_id:
        seen.problems.append(f"{where}: the picture names no frame of reference")
    if value.format not in MAGIC or not value.data.startswith(MAGIC[value.format]):
        seen.problems.append(f"{where}: expected a {value.format or 'jpeg or png'}, got other bytes")
        return
    picture = cv2.imdecode(np.frombuffer(value.data, np.uint8), cv2.IMREAD_UNCHANGED)
    if picture is None:
        seen.problems.append(f"{where}: the {value.format} cannot be decoded")
        return
    if value.frame_id == CAMERA:
        seen.sizes.setdefault(picture.shape[:2], channel.topic)
    if "255" in channel.metadata.get("classes", "") and not channel.topic.endswith("/confidence"):
        invalid = (picture != 0) & (picture != 255)
        if invalid.any():
            seen.problems.append(f"{where}: a mask holds 0 and 255 only, got {int(picture[invalid][0])}")


def _sizes(seen: Seen) -> list[str]:
    sizes = [f"{width} x {height} ({topic})" for (height, width), topic in seen.sizes.items()]
    return [f"pictures of one clip must have one size, got {', '.join(sizes)}"] if len(sizes) > 1 else []


def _complete(seen: Seen) -> list[str]:
    """Check that all image topics of a stage have the same frames, and that these are frames of the clip."""
    problems = []
    stages: dict[str, dict[str, list[int]]] = defaultdict(dict)
    for topic, times in seen.times.items():
        stages[topic.split("/")[1]][topic] = times
    frames = set(seen.times.get(FRAMES, ()))
    for topics in stages.values():
        first = next(iter(topics))
        for topic, times in topics.items():
            missing = set(topics[first]) ^ set(times)
            if missing:
                problems.append(f"{topic} and {first} do not have the same frames: {len(missing)} differ, "
                                f"the first at {(min(missing) - EPOCH_NS) / SECOND_NS:.3f} s")  # fmt: skip
            if frames and not frames.issuperset(times):
                problems.append(f"{topic} has pictures at times at which {FRAMES} has none")
    return problems
