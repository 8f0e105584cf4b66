"""MCAP files of a run's messages: written chunk by chunk while the run goes on, and read also when they end too early.

The writer is our own, because the one of the package `mcap` costs more CPU time to import (21 ms) than a run with nothing to do may
spend on its history. It writes JSON messages in chunks with CRCs, message indexes, statistics and a summary, as the MCAP
specification demands; tests read its files with the package.

A chunk reaches the file at once (`flush`), so that a killed process loses at most what it has not flushed.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX, STATISTICS, DATA_END = 1, 2, 3, 4, 5, 6, 7, 8, 11, 15
LIBRARY = "afford"
CHUNK_BYTES = 1 << 18
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
"""opcode, length of the content, channel, sequence, log time, publish time"""
FOOTER_HEAD, DATA_END_HEAD, CRC = struct.Struct("<BQQQ"), struct.Struct("<BQ"), struct.Struct("<I")
encode = json.JSONEncoder(separators=(",", ":"), ensure_ascii=False).encode
"""compact JSON; one encoder for all messages is twice as fast as `json.dumps`"""


class BrokenLogError(ValueError):
    """A log whose bytes do not match their checksums, or that is no MCAP file."""


class LoggedMessage(NamedTuple):
    """One message of a log."""

    topic: str
    time_ns: int
    """wall clock, ns since 1970"""
    data: dict[str, Any]


class LogWriter:
    """Writes an MCAP file to an open descriptor; OSError when the disk is full.

    topics: topic -> JSON schema of its messages, which are objects. `compress` compresses the chunks that are written from then on.
    """

    def __init__(self, file: int, topics: Mapping[str, Mapping[str, Any]]) -> None:
        self.compress = False
        self._file, self._offset, self._crc = file, 0, 0
        self._ids = {topic: number for number, topic in enumerate(topics, 1)}
        self._counts = dict.fromkeys(self._ids.values(), 0)
        self._definitions = b"".join(_definition(number, topic, topics[topic]) for topic, number in self._ids.items())
        self._chunk, self._indexes = bytearray(self._definitions), dict[int, list[tuple[int, int]]]()
        self._chunks: list[bytes] = []
        self._span: tuple[int, int] | None = None
        self._chunk_span: tuple[int, int] | None = None
        self._put(MAGIC + _record(HEADER, _text("") + _text(LIBRARY)))

    def write(self, topic: str, time_ns: int, data: Mapping[str, Any]) -> None:
        """Add a message; the chunk is flushed when it is large enough."""
        channel, payload = self._ids[topic], encode(data).encode()
        self._indexes.setdefault(channel, []).append((time_ns, len(self._chunk)))
        self._chunk += MESSAGE_HEAD.pack(MESSAGE, 22 + len(payload), channel, self._counts[channel] & 0xFFFFFFFF, time_ns, time_ns)
        self._chunk += payload
        self._counts[channel] += 1
        self._chunk_span = _widened(self._chunk_span, time_ns)
        if len(self._chunk) >= CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write the messages so far; they survive the end of this process."""
        if self._chunk_span is None:
            return
        data, name = bytes(self._chunk), ""
        if self.compress:
            import zstandard

            data, name = zstandard.compress(data), "zstd"
        start, end = self._chunk_span
        head = struct.pack("<QQQI", start, end, len(self._chunk), zlib.crc32(self._chunk)) + _text(name)
        chunk = _record(CHUNK, head + struct.pack("<Q", len(data)) + data)
        places, indexes = b"", b""
        for channel, rows in self._indexes.items():
            places += struct.pack("<HQ", channel, self._offset + len(chunk) + len(indexes))
            packed = b"".join(struct.pack("<QQ", *row) for row in rows)
            indexes += _record(MESSAGE_INDEX, struct.pack("<H", channel) + _bytes(packed))
        sizes = struct.pack("<Q", len(indexes)) + _text(name) + struct.pack("<QQ", len(data), len(self._chunk))
        index = struct.pack("<QQQQ", start, end, self._offset, len(chunk)) + _bytes(places) + sizes
        self._chunks.append(_record(CHUNK_INDEX, index))
        self._put(chunk + indexes)
        self._span = _widened(_widened(self._span, start), end)
        self._chunk, self._indexes, self._chunk_span = bytearray(), {}, None

    def finish(self) -> None:
        """Write the rest, the summary and the footer."""
        self.flush()
        self._put(_record(DATA_END, CRC.pack(self._crc)))
        summary = self._definitions + self._statistics() + b"".join(self._chunks)
        footer = FOOTER_HEAD.pack(FOOTER, 20, self._offset, 0)
        self._put(summary + footer + CRC.pack(zlib.crc32(summary + footer)) + MAGIC)

    def _statistics(self) -> bytes:
        start, end = self._span or (0, 0)
        counts = b"".join(struct.pack("<HQ", *row) for row in self._counts.items())
        return _record(STATISTICS, struct.pack("<QHIIIIQQ", sum(self._counts.values()), len(self._ids), len(self._ids), 0, 0,
                                               len(self._chunks), start, end) + _bytes(counts))  # fmt: skip

    def _put(self, data: bytes) -> None:
        self._crc = zlib.crc32(data, self._crc)
        self._offset += len(data)
        view = memoryview(data)
        while view:
            view = view[os.write(self._file, view):]


def _definition(number: int, topic: str, schema: Mapping[str, Any]) -> bytes:
    """Schema record and channel record of a topic."""
    text = _text(str(schema["title"])) + _text("jsonschema") + _bytes(encode(schema).encode())
    return (_record(SCHEMA, struct.pack("<H", number) + text)
            + _record(CHANNEL, struct.pack("<HH", number, number) + _text(topic) + _text("json") + _bytes(b"")))


def _record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def _bytes(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def _text(text: str) -> bytes:
    return _bytes(text.encode())


def _widened(span: tuple[int, int] | None, time_ns: int) -> tuple[int, int]:
    return (time_ns, time_ns) if span is None else (min(span[0], time_ns), max(span[1], time_ns))


# -- read --------------------------------------------------------------------------------------------------------------


def is_finished(path: Path) -> bool:
    """Return True when the file has a footer: its writer was not killed."""
    with path.open("rb") as stream:
        return stream.seek(0, os.SEEK_END) > 2 * len(MAGIC) and _ends_with_magic(stream)


def _ends_with_magic(stream: Any) -> bool:
    stream.seek(-len(MAGIC), os.SEEK_END)
    return bool(stream.read() == MAGIC)


def read_log(path: Path, topics: tuple[str, ...] | None = None) -> Iterator[LoggedMessage]:
    """Yield the messages of some topics, or of all, in the order in which they were written.

    Of a finished file only the chunks with these topics are read. A file that ends too early is read as far as it goes.
    BrokenLogError when bytes have changed.
    """
    import zstandard
    from mcap.exceptions import McapError

    read = _messages if is_finished(path) else _messages_to_the_end
    try:
        yield from read(path, topics)
    except (McapError, ValueError, LookupError, OverflowError, zstandard.ZstdError, struct.error) as error:
        raise BrokenLogError(f"{path} is damaged ({type(error).__name__}); delete it, no result depends on it") from error


def _messages(path: Path, topics: tuple[str, ...] | None) -> Iterator[LoggedMessage]:
    from mcap.reader import SeekingReader

    _check_sums(path)
    with path.open("rb") as stream:
        reader = SeekingReader(stream, validate_crcs=True)
        for _, channel, message in reader.iter_messages(topics=topics, log_time_order=False):
            yield LoggedMessage(channel.topic, message.log_time, json.loads(message.data))


def _check_sums(path: Path) -> None:
    """Check the CRCs of the data section and of the summary, which the package's reader of single topics does not.

    ValueError when one differs.
    """
    data = path.read_bytes()
    end = len(data) - len(MAGIC) - CRC.size
    start = FOOTER_HEAD.unpack(data[end - FOOTER_HEAD.size:end])[2]
    sums = [*CRC.unpack(data[start - CRC.size:start]), *CRC.unpack(data[end:end + CRC.size])]
    if sums != [zlib.crc32(data[:start - DATA_END_HEAD.size - CRC.size]), zlib.crc32(data[start:end])]:
        raise ValueError("checksum")


def _messages_to_the_end(path: Path, topics: tuple[str, ...] | None) -> Iterator[LoggedMessage]:
    from mcap.exceptions import EndOfFile
    from mcap.records import Channel, Message
    from mcap.stream_reader import StreamReader

    names: dict[int, str] = {}
    with path.open("rb") as stream:
        records: Iterator[Any] = StreamReader(stream, validate_crcs=True).records
        while (record := _next(records, (EndOfFile, struct.error))) is not None:
            if isinstance(record, Channel):
                names[record.id] = record.topic
            elif isinstance(record, Message) and (topics is None or names[record.channel_id] in topics):
                yield LoggedMessage(names[record.channel_id], record.log_time, json.loads(record.data))


def _next(records: Iterator[Any], end: tuple[type[Exception], ...]) -> Any:
    """Next record; None at the end of the file, also in the middle of a record."""
    try:
        return next(records, None)
    except end:
        return None
