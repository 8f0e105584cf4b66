"""Curves as a TensorBoard event file, without TensorBoard: records of tf.Event, each with its masked CRC-32C.

`wall_time` is a fixed base plus a millisecond per step, so that the same training gives the same bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

BASE_S = 1_577_836_800.0
"""2020-01-01T00:00:00Z"""
STEP_S = 0.001
NAME = "events.out.tfevents.0000000000.afford"
POLYNOMIAL = 0x82F63B78
MASK_DELTA = 0xA282EAD8


class Point(NamedTuple):
    """One measured scalar."""

    step: int
    name: str
    value: float


def write(folder: Path, points: Iterable[Point]) -> Path:
    """Write the event file of these points, replacing what was there."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / NAME
    partial = folder / ".partial"  # TensorBoard reads files with `tfevents` in their name only
    partial.write_bytes(b"".join([_record(_version()), *(_record(_event(point)) for point in points)]))
    partial.replace(path)
    return path


def _version() -> bytes:
    return _double(1, BASE_S) + _bytes(3, b"brain.Event:2")


def _event(point: Point) -> bytes:
    scalar = _bytes(1, point.name.replace(".", "/", 1).encode()) + b"\x15" + struct.pack("<f", point.value)
    return _double(1, BASE_S + STEP_S * point.step) + b"\x10" + _varint(point.step) + _bytes(5, _bytes(1, scalar))


def _double(field: int, value: float) -> bytes:
    return _varint(field << 3 | 1) + struct.pack("<d", value)


def _bytes(field: int, value: bytes) -> bytes:
    return _varint(field << 3 | 2) + _varint(len(value)) + value


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def _record(data: bytes) -> bytes:
    length = struct.pack("<Q", len(data))
    return length + _masked(length) + data + _masked(data)


def _masked(data: bytes) -> bytes:
    crc = crc32c(data)
    return struct.pack("<I", ((crc >> 15 | crc << 17) + MASK_DELTA) & 0xFFFFFFFF)


def _table() -> list[int]:
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = byte >> 1 ^ (POLYNOMIAL if byte & 1 else 0)
        table.append(byte)
    return table


TABLE = _table()


def crc32c(data: bytes) -> int:
    """CRC-32C (Castagnoli)."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc = TABLE[(crc ^ byte) & 0xFF] ^ crc >> 8
    return crc ^ 0xFFFFFFFF
