"""What a recording says, apart from how it lies on disk: channels, messages in time order, metadata, attachments.

Log time = publish time = timestamp of the payload = media time since a fixed base, in ns: never the wall clock, so that the
same clip gives the same recording every time.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from operator import attrgetter
from typing import NamedTuple

from blake3 import blake3

EPOCH_NS = 1_577_836_800 * 10**9
"""2020-01-01T00:00:00Z: media time 0 of every recording"""


class Message(NamedTuple):
    """One payload on one topic."""

    time_ns: int
    """EPOCH_NS + media time"""
    topic: str
    data: bytes


@dataclass(frozen=True)
class Channel:
    """A topic and how to read its payloads."""

    topic: str
    schema: str
    """full protobuf name"""
    definition: bytes
    """serialized FileDescriptorSet"""
    metadata: tuple[tuple[str, str], ...] = ()
    """sorted by key"""


@dataclass(frozen=True)
class Attachment:
    """A file inside the recording."""

    name: str
    media_type: str
    data: bytes


@dataclass(frozen=True)
class Recording:
    """`messages` may be a generator: it can be walked once."""

    channels: tuple[Channel, ...]
    messages: Iterable[Message]
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: tuple[Attachment, ...] = ()


def in_order(messages: Iterable[Message]) -> Iterator[Message]:
    """Messages of non-decreasing time, those of one time by topic; ValueError when time runs backwards."""
    last = 0
    for time_ns, group in groupby(messages, key=attrgetter("time_ns")):
        if time_ns < last:
            raise ValueError(f"messages must come in time order, got {time_ns} ns after {last} ns")
        last = time_ns
        yield from sorted(group, key=attrgetter("topic"))


def content_digest(recording: Recording) -> str:
    """Hex blake3 of the content: the same for any chunk size, compression, library version and order of registration."""
    hasher = blake3()
    for channel in sorted(recording.channels, key=attrgetter("topic")):
        _feed(hasher, "channel", channel.topic, channel.schema, channel.definition, *_flat(dict(channel.metadata)))
    for message in in_order(recording.messages):
        _feed(hasher, "message", message.topic, str(message.time_ns), message.data)
    for name, values in sorted(recording.metadata.items()):
        _feed(hasher, "metadata", name, *_flat(values))
    for item in sorted(recording.attachments, key=attrgetter("name")):
        _feed(hasher, "attachment", item.name, item.media_type, item.data)
    return hasher.hexdigest()


def _flat(values: Mapping[str, str]) -> list[str]:
    return [word for pair in sorted(values.items()) for word in pair]


def _feed(hasher: blake3, *parts: str | bytes) -> None:
    for part in (str(len(parts)), *parts):
        data = part.encode() if isinstance(part, str) else part
        hasher.update(f"{len(data)}:".encode() + data)
