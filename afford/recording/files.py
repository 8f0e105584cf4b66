"""Recordings on disk: MCAP with zstd chunks of 1 MiB, all indexes, all checksums and a fixed library string."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from operator import attrgetter
from pathlib import Path

from blake3 import blake3
from mcap import records
from mcap.reader import McapReader, make_reader
from mcap.writer import Writer

from afford.recording.content import Attachment, Channel, Message, Recording, in_order
from schemas.files import FileRef, FileTree

LIBRARY = "afford"
"""instead of the writer's own name and version, so that an upgrade does not change every recording"""
CHUNK_BYTES = 1 << 20
ENCODING = "protobuf"


def write(path: Path, recording: Recording) -> None:
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
def opened(path: Path) -> Iterator[Recording]:
    """A recording whose messages are read while they are used, every chunk checked against its CRC."""
    with path.open("rb") as stream:
        yield read(make_reader(stream, validate_crcs=True))


def read(reader: McapReader, topics: tuple[str, ...] | None = None) -> Recording:
    """The content behind a reader, of some topics or of all."""
    summary = reader.get_summary()
    if summary is None:
        raise ValueError("the recording has no summary: it was not finished; recover it with `rerun mcap convert --recover`")
    wanted = [c for c in sorted(summary.channels.values(), key=attrgetter("topic")) if topics is None or c.topic in topics]
    channels = tuple(_channel(channel, summary.schemas[channel.schema_id]) for channel in wanted)
    found = reader.iter_messages(topics=topics)
    messages = in_order(Message(message.log_time, channel.topic, message.data) for _, channel, message in found)
    metadata = {record.name: dict(sorted(record.metadata.items())) for record in reader.iter_metadata()}
    attachments = tuple(Attachment(item.name, item.media_type, item.data) for item in reader.iter_attachments())
    return Recording(channels, messages, metadata, attachments)


def _channel(channel: records.Channel, schema: records.Schema) -> Channel:
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
    """Topic -> channel id; every schema once."""
    definitions = {channel.schema: channel.definition for channel in channels}
    schemas = {name: writer.register_schema(name, ENCODING, data) for name, data in sorted(definitions.items())}
    return {c.topic: writer.register_channel(c.topic, ENCODING, schemas[c.schema], dict(c.metadata))
            for c in sorted(channels, key=attrgetter("topic"))}  # fmt: skip
