"""Summary of a recording from its indexes alone: a gigabyte is summarised without reading a picture."""

from __future__ import annotations

import struct
from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise
from os import SEEK_END
from pathlib import Path
from typing import IO

from mcap.reader import McapReader, make_reader
from mcap.records import ChunkIndex
from mcap.records import Statistics as McapStatistics

from afford.recording.check_file import MAGIC
from afford.recording.mcap_files import EPOCH_NS

RECORD_HEAD, MESSAGE_HEAD = 9, 31
"""bytes of opcode and length of a record; of these and the fixed fields of a message"""
SECOND_NS = 10**9
RECOVER = "`rerun mcap convert --recover` saves what is there"


@dataclass(frozen=True)
class Topic:
    """Summary of one topic; times are media time."""

    topic: str
    schema: str
    messages: int
    bytes: int
    """payloads before compression"""
    start_s: float
    end_s: float
    hz: float
    """messages per second between the first and the last, 0 for fewer than two"""
    longest_gap_s: float


@dataclass(frozen=True)
class Summary:
    """Summary of a recording; `problem` is '' for a readable one."""

    path: str
    bytes: int
    problem: str
    topics: tuple[Topic, ...] = ()
    messages: int = 0
    chunks: int = 0
    start_s: float = 0.0
    seconds: float = 0.0
    library: str = ""
    metadata: dict[str, dict[str, str]] | None = None
    attachments: tuple[str, ...] = ()


def summarise(path: Path) -> Summary:
    """Read the indexes of a file; an unfinished or damaged recording gives a Summary with a problem."""
    size = path.stat().st_size
    try:
        with path.open("rb") as stream:
            problem = _ends(stream, size)
            return Summary(str(path), size, problem) if problem else _read(path, size, stream)
    except OSError as error:
        return Summary(str(path), size, f"cannot be read: {error.strerror or error}")


def _ends(stream: IO[bytes], size: int) -> str:
    """Check the first and last bytes of a file; '' for those of a finished MCAP file."""
    if size < 2 * len(MAGIC):
        return f"too short for an MCAP file: {size} bytes"
    if stream.read(len(MAGIC)) != MAGIC:
        return "no MCAP file: its first bytes are those of another kind"
    stream.seek(-len(MAGIC), SEEK_END)
    return "" if stream.read() == MAGIC else f"cut short: its last bytes are not those of MCAP; {RECOVER}"


def _read(path: Path, size: int, stream: IO[bytes]) -> Summary:
    stream.seek(0)
    try:
        return _summary(path, size, stream, make_reader(stream))
    except OSError:
        raise
    except Exception:  # a damaged length can raise anything
        return Summary(str(path), size, "damaged: its summary cannot be read or does not fit its chunks; --strict says where")


def _summary(path: Path, size: int, stream: IO[bytes], reader: McapReader) -> Summary:
    found = reader.get_summary()
    if found is None or found.statistics is None:
        return Summary(str(path), size, f"has no summary: not finished; {RECOVER}")
    times, lengths = _messages(stream, found.chunk_indexes)
    topics = tuple(sorted((_topic(c.topic, found.schemas[c.schema_id].name, times[c.id], lengths[c.id])
                           for c in found.channels.values()), key=lambda t: t.topic))  # fmt: skip
    metadata = {record.name: dict(record.metadata) for record in reader.iter_metadata()}
    total = found.statistics
    return Summary(
        str(path), size, _problem(topics, total, metadata), topics, total.message_count, total.chunk_count,
        _media_s(total.message_start_time), (total.message_end_time - total.message_start_time) / SECOND_NS,
        reader.get_header().library, metadata, tuple(sorted(index.name for index in found.attachment_indexes)))  # fmt: skip


def _problem(topics: tuple[Topic, ...], total: McapStatistics, metadata: dict[str, dict[str, str]]) -> str:
    indexed = sum(topic.messages for topic in topics)
    if indexed != total.message_count:
        return f"index and statistics disagree: {indexed} messages against {total.message_count}"
    if not indexed:
        return "holds no message"
    known = any(name.split("/")[0] == "provenance" for name in metadata)
    return "" if known else "does not say where it comes from (no provenance)"


def _messages(stream: IO[bytes], chunks: list[ChunkIndex]) -> tuple[dict[int, list[int]], dict[int, int]]:
    """Log times in file order and payload bytes of each channel, from the message indexes behind each chunk."""
    times: dict[int, list[int]] = defaultdict(list)
    lengths: dict[int, int] = defaultdict(int)
    for chunk in chunks:
        stream.seek(chunk.chunk_start_offset + chunk.chunk_length)
        entries = _entries(stream.read(chunk.message_index_length))
        ends = [offset for offset, _, _ in entries[1:]] + [chunk.uncompressed_size]
        for (offset, time_ns, channel), end in zip(entries, ends, strict=True):
            times[channel].append(time_ns)
            lengths[channel] += end - offset - MESSAGE_HEAD
    return times, lengths


def _entries(data: bytes) -> list[tuple[int, int, int]]:
    """(offset in the chunk, log time, channel) of every message of a chunk, in file order."""
    found: list[tuple[int, int, int]] = []
    at = 0
    while at < len(data):
        _, length, channel, _ = struct.unpack_from("<BQHI", data, at)
        body = data[at + RECORD_HEAD + 6 : at + RECORD_HEAD + length]
        found += [(offset, time_ns, channel) for time_ns, offset in struct.iter_unpack("<QQ", body)]
        at += RECORD_HEAD + length
    return sorted(found)


def _topic(topic: str, schema: str, times: list[int], length: int) -> Topic:
    if not times:
        return Topic(topic, schema, 0, 0, 0.0, 0.0, 0.0, 0.0)
    span = (times[-1] - times[0]) / SECOND_NS
    gap = max((b - a for a, b in pairwise(times)), default=0) / SECOND_NS
    hz = (len(times) - 1) / span if span > 0 else 0.0
    return Topic(topic, schema, len(times), length, _media_s(times[0]), _media_s(times[-1]), hz, gap)


def _media_s(time_ns: int) -> float:
    return (time_ns - EPOCH_NS) / SECOND_NS
