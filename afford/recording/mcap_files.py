"""Recordings as data and as MCAP files: channels, messages in time order, metadata, attachments; write, read, merge.

Log time = publish time = timestamp of the payload = media time since a fixed base, in ns. It is never the wall clock, so the same
clip gives the same recording every time. Files have zstd chunks of 1 MiB, all indexes, all checksums and a fixed library string.
"""

from __future__ import annotations

import heapq
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from itertools import groupby
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from blake3 import blake3
from mcap import records
from mcap.reader import McapReader, make_reader
from mcap.writer import Writer

from schemas.files import FileRef, FileTree

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
    """A topic and the schema of its payloads."""

    topic: str
    schema: str
    """full protobuf name"""
    definition: bytes
    """serialized FileDescriptorSet"""
    metadata: tuple[tuple[str, str], ...] = ()
    """sorted by key"""


@dataclass(frozen=True)
class Attachment:
    """A file inside a recording."""

    name: str
    media_type: str
    data: bytes


@dataclass(frozen=True)
class Recording:
    """Content of a recording. `messages` may be a generator, to be iterated once."""

    channels: tuple[Channel, ...]
    messages: Iterable[Message]
    metadata: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    attachments: tuple[Attachment, ...] = ()


def in_order(messages: Iterable[Message]) -> Iterator[Message]:
    """Yield messages in time order, those of one time by topic; ValueError when time runs backwards."""
    last = 0
    for time_ns, group in groupby(messages, key=attrgetter("time_ns")):
        if time_ns < last:
            raise ValueError(f"messages must come in time order, got {time_ns} ns after {last} ns")
        last = time_ns
        yield from sorted(group, key=attrgetter("topic"))


LIBRARY = "afford"
"""replaces the writer's own name and version, so that an upgrade does not change every recording"""
CHUNK_BYTES = 1 << 20
ENCODING = "protobuf"


def write_recording(path: Path, recording: Recording) -> None:
    """Write a recording; the file appears under its name when it is complete."""
    partial = path.with_name(path.name + ".partial")
    with partial.open("wb") as stream:
        writer = Writer(stream, chunk_size=CHUNK_BYTES, enable_data_crcs=True)
        writer.start(profile="", library=LIBRARY)
        _write_content(writer, recording)
        writer.finish()
    os.replace(partial, path)


def as_tree(name: str, path: Path) -> FileTree:
    """One recording as the output of a stage."""
    data = path.read_bytes()
    return FileTree(name, (FileRef(path.name, blake3(data).hexdigest(), len(data), path),))


@contextmanager
def open_recording(path: Path) -> Iterator[Recording]:
    """Open a recording; its messages are read lazily and every chunk is checked against its CRC."""
    with path.open("rb") as stream:
        yield read_recording(make_reader(stream, validate_crcs=True))


def read_recording(reader: McapReader, topics: tuple[str, ...] | None = None) -> Recording:
    """Content behind a reader, of some topics or of all."""
    summary = reader.get_summary()
    if summary is None:
        raise ValueError("the recording has no summary: it was not finished; recover it with `rerun mcap convert --recover`")
    wanted = [c for c in sorted(summary.channels.values(), key=attrgetter("topic")) if topics is None or c.topic in topics]
    channels = tuple(_read_channel(channel, summary.schemas[channel.schema_id]) for channel in wanted)
    found = reader.iter_messages(topics=topics)
    messages = in_order(Message(message.log_time, channel.topic, message.data) for _, channel, message in found)
    metadata = {record.name: dict(sorted(record.metadata.items())) for record in reader.iter_metadata()}
    attachments = tuple(Attachment(item.name, item.media_type, item.data) for item in reader.iter_attachments())
    return Recording(channels, messages, metadata, attachments)


def _read_channel(channel: records.Channel, schema: records.Schema) -> Channel:
    return Channel(channel.topic, schema.name, schema.data, tuple(sorted(channel.metadata.items())))


def _write_content(writer: Writer, recording: Recording) -> None:
    channels = _register(writer, recording.channels)
    count = dict.fromkeys(channels, 0)
    for message in in_order(recording.messages):
        writer.add_message(channels[message.topic], message.time_ns, message.data, message.time_ns, count[message.topic])
        count[message.topic] += 1
    for item in sorted(recording.attachments, key=attrgetter("name")):
        writer.add_attachment(0, 0, item.name, item.media_type, item.data)
    for name, values in sorted(recording.metadata.items()):
        writer.add_metadata(name, dict(sorted(values.items())))


def _register(writer: Writer, channels: tuple[Channel, ...]) -> dict[str, int]:
    """Register every schema once; returns the channel id of each topic."""
    definitions = {channel.schema: channel.definition for channel in channels}
    schemas = {name: writer.register_schema(name, ENCODING, data) for name, data in sorted(definitions.items())}
    return {c.topic: writer.register_channel(c.topic, ENCODING, schemas[c.schema], dict(c.metadata))
            for c in sorted(channels, key=attrgetter("topic"))}  # fmt: skip


def merge_recordings(parts: Sequence[Path], path: Path, metadata: Mapping[str, Mapping[str, str]]) -> None:
    """Merge recordings into one in time order and add `metadata`.

    ValueError when two of them have one topic, or two definitions of one schema.
    """
    with ExitStack() as stack:
        recordings = [stack.enter_context(open_recording(part)) for part in parts]
        messages = heapq.merge(*(r.messages for r in recordings), key=attrgetter("time_ns", "topic"))
        merged = Recording(_merged_channels(recordings), messages, _merged_metadata(recordings, metadata),
                           _merged_attachments(recordings))  # fmt: skip
        write_recording(path, merged)


def _merged_channels(recordings: Sequence[Recording]) -> tuple[Channel, ...]:
    topics: dict[str, Channel] = {}
    schemas: dict[str, bytes] = {}
    for channel in (c for r in recordings for c in r.channels):
        if channel.topic in topics:
            raise ValueError(f"topic {channel.topic}: expected in one part only, got it twice")
        if schemas.setdefault(channel.schema, channel.definition) != channel.definition:
            raise ValueError(f"schema {channel.schema}: expected one definition, got two; record the parts again")
        topics[channel.topic] = channel
    return tuple(topics.values())


def _merged_metadata(recordings: Sequence[Recording], more: Mapping[str, Mapping[str, str]]) -> dict[str, Mapping[str, str]]:
    merged: dict[str, Mapping[str, str]] = {}
    for name, values in [*more.items(), *(item for r in recordings for item in r.metadata.items())]:
        if name in merged:
            raise ValueError(f"metadata {name}: expected in one part only, got it twice")
        merged[name] = values
    return merged


def _merged_attachments(recordings: Sequence[Recording]) -> tuple[Attachment, ...]:
    return tuple(item for recording in recordings for item in recording.attachments)
