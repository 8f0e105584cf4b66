"""Integrity check of an MCAP file: every record, every checksum, and every index against its target."""

from __future__ import annotations

import mmap
import struct
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, Footer, Header, Message, Schema, Statistics
from mcap.stream_reader import breakup_chunk

MAGIC = b"\x89MCAP0\r\n"
HEAD = 9
IN_DATA = {Opcode.HEADER, Opcode.CHUNK, Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END}


class DamageError(ValueError):
    """The file cannot be followed further; the message says where and why."""


@dataclass
class Seen:
    """Records met while walking through the file."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    chunks: list[ChunkIndex] = field(default_factory=list)
    last_time: int = 0
    records: Counter[int] = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)


def check_file(path: Path) -> list[str]:
    """List all problems of a file as sentences; [] for an intact file."""
    if path.stat().st_size < 2 * len(MAGIC):
        return ["too short for an MCAP file"]
    seen = Seen()
    with path.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data:
        try:
            _walk(data, seen)
        except DamageError as error:
            seen.problems.append(f"damaged: {error}")
        except Exception as error:  # a damaged length or compressed block can raise anything
            seen.problems.append(f"damaged: {type(error).__name__}: {error}")
    return seen.problems


def _walk(data: mmap.mmap, seen: Seen) -> None:
    if data[: len(MAGIC)] != MAGIC or data[-len(MAGIC) :] != MAGIC:
        raise DamageError("the first or last bytes are not those of MCAP: truncated, or another kind of file")
    in_data = True
    summary_start = 0
    for offset, opcode, length in _records(data):
        if in_data and opcode not in IN_DATA:
            seen.problems.append(f"record {opcode} at byte {offset} lies outside of the chunks, where no index finds it")
        body = ReadDataStream(BytesIO(data[offset + HEAD : offset + HEAD + length]))
        if opcode == Opcode.DATA_END:
            _data_end(DataEnd.read(body), zlib.crc32(data[:offset]), seen)
            in_data, summary_start = False, offset + HEAD + length
        elif opcode == Opcode.FOOTER:
            _footer(Footer.read(body), data, offset, summary_start, seen)
        else:
            _record(opcode, body, offset, length, in_data, seen)
    if seen.records[Opcode.STATISTICS] != 1:
        seen.problems.append("expected one statistics record in the summary")
    if seen.chunks:
        first = seen.chunks[0].chunk_start_offset
        seen.problems.append(f"{len(seen.chunks)} chunk(s) are in no index, the first at byte {first}")


def _records(data: mmap.mmap) -> Iterator[tuple[int, int, int]]:
    """Yield (offset, opcode, length of the body) of every record of the file."""
    at, end = len(MAGIC), len(data) - len(MAGIC)
    opcode = 0
    while at < end:
        if at + HEAD > end:
            raise DamageError(f"byte {at}: {end - at} bytes are left, too few for a record")
        opcode, length = struct.unpack_from("<BQ", data, at)
        if at + HEAD + length > end:
            raise DamageError(f"byte {at}: a record of {length} bytes does not fit into the file")
        yield at, opcode, length
        at += HEAD + length
    if opcode != Opcode.FOOTER:
        raise DamageError("the last record is not the footer")


def _record(opcode: int, body: ReadDataStream, offset: int, length: int, in_data: bool, seen: Seen) -> None:
    seen.records[opcode] += 1
    if opcode == Opcode.HEADER:
        header = Header.read(body)
        if not header.library:
            seen.problems.append("the header names no library")
    elif opcode == Opcode.CHUNK:
        _chunk(Chunk.read(body), offset, length, seen)
    elif opcode == Opcode.CHUNK_INDEX:
        _chunk_index(ChunkIndex.read(body), seen)
    elif opcode == Opcode.SCHEMA:
        _declare_schema(Schema.read(body), seen, repeated=not in_data)
    elif opcode == Opcode.CHANNEL:
        _declare_channel(Channel.read(body), seen, repeated=not in_data)
    elif opcode == Opcode.STATISTICS:
        _statistics(Statistics.read(body), seen)


def _chunk(chunk: Chunk, offset: int, length: int, seen: Seen) -> None:
    if not chunk.uncompressed_crc:
        seen.problems.append(f"the chunk at byte {offset} has no checksum")
    times: list[int] = []
    for record in breakup_chunk(chunk, validate_crc=True):
        if isinstance(record, Schema):
            _declare_schema(record, seen)
        elif isinstance(record, Channel):
            _declare_channel(record, seen)
        elif isinstance(record, Message):
            _message(record, seen)
            times.append(record.log_time)
    if times and (min(times), max(times)) != (chunk.message_start_time, chunk.message_end_time):
        seen.problems.append(f"the chunk at byte {offset} says it spans other times than its messages do")
    seen.chunks.append(ChunkIndex(
        chunk_length=HEAD + length, chunk_start_offset=offset, compression=chunk.compression, compressed_size=len(chunk.data),
        message_end_time=chunk.message_end_time, message_index_length=0, message_index_offsets={},
        message_start_time=chunk.message_start_time, uncompressed_size=chunk.uncompressed_size))  # fmt: skip


def _message(message: Message, seen: Seen) -> None:
    seen.counts[message.channel_id] += 1
    if message.channel_id not in seen.channels:
        seen.problems.append(f"a message at {message.log_time} ns is on channel {message.channel_id}, not declared before")
    if message.log_time < seen.last_time:
        seen.problems.append(f"log time runs backwards at {message.log_time} ns")
    seen.last_time = max(seen.last_time, message.log_time)


def _declare_schema(schema: Schema, seen: Seen, repeated: bool = False) -> None:
    if schema.id == 0 or not schema.encoding:
        seen.problems.append(f"schema {schema.name!r} has id 0 or no encoding")
    if schema.id in seen.schemas and seen.schemas[schema.id] != schema:
        seen.problems.append(f"schema {schema.id} is declared twice, differently")
    if repeated and schema.id not in seen.schemas:
        seen.problems.append(f"the summary holds schema {schema.name!r}, which the data do not")
    seen.schemas.setdefault(schema.id, schema)


def _declare_channel(channel: Channel, seen: Seen, repeated: bool = False) -> None:
    if channel.schema_id not in seen.schemas:
        seen.problems.append(f"topic {channel.topic} uses schema {channel.schema_id}, which was not declared before")
    if channel.id in seen.channels and seen.channels[channel.id] != channel:
        seen.problems.append(f"channel {channel.id} is declared twice, differently")
    if repeated and channel.id not in seen.channels:
        seen.problems.append(f"the summary holds topic {channel.topic}, which the data do not")
    seen.channels.setdefault(channel.id, channel)


def _chunk_index(index: ChunkIndex, seen: Seen) -> None:
    names = ("chunk_length", "compression", "compressed_size", "message_start_time", "message_end_time", "uncompressed_size")
    chunk = next((c for c in seen.chunks if c.chunk_start_offset == index.chunk_start_offset), None)
    if chunk is None:
        seen.problems.append(f"the index points to a chunk at byte {index.chunk_start_offset}, where there is none")
        return
    seen.chunks.remove(chunk)
    seen.problems.extend(f"the index of the chunk at byte {index.chunk_start_offset} has another {name}"
                         for name in names if getattr(index, name) != getattr(chunk, name))  # fmt: skip


def _statistics(total: Statistics, seen: Seen) -> None:
    counted = {"message_count": sum(seen.counts.values()), "channel_count": len(seen.channels),
               "schema_count": len(seen.schemas), "chunk_count": seen.records[Opcode.CHUNK],
               "attachment_count": seen.records[Opcode.ATTACHMENT],
               "metadata_count": seen.records[Opcode.METADATA]}  # fmt: skip
    seen.problems.extend(f"statistics say {name} {getattr(total, name)}, the file has {found}"
                         for name, found in counted.items() if getattr(total, name) != found)  # fmt: skip
    if {k: n for k, n in total.channel_message_counts.items() if n} != dict(seen.counts):
        seen.problems.append("statistics disagree with the number of messages of some topic")


def _data_end(end: DataEnd, found: int, seen: Seen) -> None:
    if end.data_section_crc != found:
        seen.problems.append(f"the data have checksum {found:08x}, expected {end.data_section_crc:08x}: bytes were changed")


def _footer(footer: Footer, data: mmap.mmap, offset: int, summary_start: int, seen: Seen) -> None:
    found = zlib.crc32(data[summary_start : offset + HEAD + 16])
    if footer.summary_start != summary_start:
        seen.problems.append(f"the footer puts the summary at byte {footer.summary_start}, it begins at {summary_start}")
    if footer.summary_crc != found:
        seen.problems.append(f"the summary has checksum {found:08x}, expected {footer.summary_crc:08x}: bytes were changed")
