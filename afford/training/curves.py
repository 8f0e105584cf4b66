"""Training curves: logged scalars as a TensorBoard event file, as a TrainingLog and as a table of a model card.

The event file is written without TensorBoard: records of tf.Event, each with its masked CRC-32C. `wall_time` is a fixed base plus
a millisecond per step, so that the same training gives the same bytes on every machine.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from schemas.training import Curve, TrainingLog

EVENTS_FILE = "events.out.tfevents.0000000000.afford"
BASE_S = 1_577_836_800.0
"""wall time of step 0: 2020-01-01T00:00:00Z"""
STEP_S = 0.001
POLYNOMIAL = 0x82F63B78
"""of CRC-32C, reflected"""
MASK_DELTA = 0xA282EAD8
"""added to a CRC that is stored beside its data (TensorFlow's record format)"""


class Point(NamedTuple):
    """One logged scalar."""

    step: int
    name: str
    value: float


class EventWriter:
    """Append-only TensorBoard event file of one training."""

    def __init__(self, folder: Path, points: Sequence[Point]) -> None:
        """Write the events of `points`, those of the checkpoint that a training resumes from.

        The file of a killed process is replaced: it may hold later events, or half of one.
        """
        self.path = write_events(folder, points)
        self.written = len(points)

    def append(self, points: Sequence[Point]) -> None:
        """Append the events of `points`, all points of the training so far, that are not in the file yet."""
        with self.path.open("ab") as file:
            file.write(b"".join(_record(_event(point)) for point in points[self.written :]))
        self.written = len(points)


def write_events(folder: Path, points: Iterable[Point]) -> Path:
    """Write the whole event file, atomically."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / EVENTS_FILE
    partial = folder / ".partial"  # TensorBoard reads files with `tfevents` in their name only
    partial.write_bytes(b"".join([_record(_version()), *(_record(_event(point)) for point in points)]))
    partial.replace(path)
    return path


def training_log(name: str, points: Sequence[Point], best_step: int, steps: int) -> TrainingLog:
    """Sort the points of a training into curves."""
    names = sorted({point.name for point in points})
    return TrainingLog(name, tuple(_curve(curve, points) for curve in names), best_step, steps)


def _curve(name: str, points: Iterable[Point]) -> Curve:
    own = [point for point in points if point.name == name]
    return Curve(name, np.array([point.step for point in own], np.int64), np.array([point.value for point in own], np.float64))


def scores_at_best(log: TrainingLog) -> dict[str, float]:
    """Validation scores at the step whose weights were kept, by measure; empty when that step was not validated."""
    return {curve.name.removeprefix("val."): float(curve.value[curve.step == log.best_step][0])
            for curve in log.curves if curve.name.startswith("val.") and log.best_step in curve.step}  # fmt: skip


def scores_table(scores: Mapping[str, float]) -> str:
    """Markdown table of scores by name."""
    if not scores:
        return "None: the last weights were kept."
    return "\n".join(["| measure | value |", "|---|--:|", *(f"| {name} | {value:.3f} |" for name, value in sorted(scores.items()))])


def _version() -> bytes:
    return _double(1, BASE_S) + _bytes(3, b"brain.Event:2")


def _event(point: Point) -> bytes:
    """Protobuf bytes of tf.Event with one scalar summary."""
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
    """TFRecord: length, CRC of the length, data, CRC of the data."""
    length = struct.pack("<Q", len(data))
    return length + _masked_crc(length) + data + _masked_crc(data)


def _masked_crc(data: bytes) -> bytes:
    crc = crc32c(data)
    return struct.pack("<I", ((crc >> 15 | crc << 17) + MASK_DELTA) & 0xFFFFFFFF)


def _crc_table() -> list[int]:
    entries = []
    for byte in range(256):
        for _ in range(8):
            byte = byte >> 1 ^ (POLYNOMIAL if byte & 1 else 0)
        entries.append(byte)
    return entries


CRC_TABLE = _crc_table()


def crc32c(data: bytes) -> int:
    """CRC-32C (Castagnoli) of data."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc = CRC_TABLE[(crc ^ byte) & 0xFF] ^ crc >> 8
    return crc ^ 0xFFFFFFFF
