"""Reader of one numeric matrix of a MATLAB 5 file; other variables are skipped, and decompression is bounded.

A file is a header of 128 bytes and elements: a tag (type, bytes) and data, which may be elements again or zlib-compressed. The size
in a tag is checked before its data is read.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from afford.common.bounded import MAX_ARRAY_BYTES, TooLargeError
from afford.common.errors import SourceError

HEADER, TAG = 128, 8
INT32, UINT32, MATRIX, COMPRESSED = 5, 6, 14, 15
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""type of an element -> dtype of its numbers"""
CLASSES = range(6, 16)
"""classes of numeric arrays: double, single and integers; text, cells, objects and sparse matrices have other classes"""
COMPLEX = 0x08


class _Element(NamedTuple):
    kind: int
    data: memoryview
    end: int
    """offset of the next element"""


def read_matrix(data: bytes, variable: str, name: str) -> np.ndarray | None:
    """Read the first array called `variable`, None when there is none.

    Elements are whole or real numbers in the dtype of the file. SourceError for a damaged file or another format, TooLargeError
    for an array beyond MAX_ARRAY_BYTES.
    """
    order = {b"IM": "<", b"MI": ">"}.get(data[126:HEADER])
    if order is None:
        raise _refused(name, "another header")
    for matrix in _matrices(memoryview(data)[HEADER:], order, name):
        parts = _parts(matrix, order, name)
        if parts[2].kind == 1 and bytes(parts[2].data) == variable.encode():
            return _numbers(parts, order, name)
    return None


def _matrices(data: memoryview, order: str, name: str) -> Iterator[memoryview]:
    """Yield the data of every matrix of a file, decompressed."""
    at = 0
    while at < len(data):
        element = _element(data, at, order, name, padded=False)
        at = element.end
        if element.kind == COMPRESSED:
            element = _unpacked(element.data, order, name)
        if element.kind == MATRIX:
            yield element.data


def _unpacked(data: memoryview, order: str, name: str) -> _Element:
    """Decompress the one element of compressed data: its tag, then the number of bytes in the tag."""
    unpack = zlib.decompressobj()
    try:
        tag = unpack.decompress(data, TAG)
        if len(tag) < TAG:
            raise _refused(name, "a compressed element without a tag")
        kind, length = np.frombuffer(tag, f"{order}u4").tolist()
        if length > MAX_ARRAY_BYTES:
            limit = f"arrays of at most {MAX_ARRAY_BYTES >> 20} MiB"
            raise TooLargeError(name, limit, f"one of {length >> 20} MiB", "is it the label file?")
        body = unpack.decompress(unpack.unconsumed_tail, length) if length else b""
    except zlib.error as error:
        raise _refused(name, str(error)) from error
    if len(body) < length:
        raise _refused(name, f"{len(body)} of {length} bytes of an element")
    return _Element(kind, memoryview(body), 0)


def _parts(matrix: memoryview, order: str, name: str) -> list[_Element]:
    """Flags, dimensions and name of a matrix, and its numbers if any."""
    parts: list[_Element] = []
    at = 0
    while at < len(matrix) and len(parts) < 4:
        parts.append(_element(matrix, at, order, name, padded=True))
        at = parts[-1].end
    if len(parts) < 3:
        raise _refused(name, "a matrix without flags, dimensions and name")
    return parts


def _numbers(parts: list[_Element], order: str, name: str) -> np.ndarray:
    flags, dimensions = parts[0], parts[1]
    if flags.kind != UINT32 or len(flags.data) != 8 or dimensions.kind != INT32 or len(dimensions.data) % 4 or len(parts) < 4:
        raise _refused(name, "a matrix with other parts")
    word = int(np.frombuffer(flags.data, f"{order}u4")[0])
    shape = np.frombuffer(dimensions.data, f"{order}i4").tolist()
    if word & 0xFF not in CLASSES or word >> 8 & COMPLEX or parts[3].kind not in NUMBERS or min(shape, default=-1) < 0:
        raise _refused(name, "an array of something else than real numbers")
    dtype = np.dtype(order + NUMBERS[parts[3].kind])
    if math.prod(shape) * dtype.itemsize != len(parts[3].data):
        raise _refused(name, f"{len(parts[3].data)} bytes for {tuple(shape)} of {dtype}")
    return np.frombuffer(parts[3].data, dtype).reshape(shape, order="F")


def _element(data: memoryview, at: int, order: str, name: str, *, padded: bool) -> _Element:
    """Element at an offset; small elements have length and data in the tag."""
    if at + TAG > len(data):
        raise _refused(name, "an end within a tag")
    kind, length = np.frombuffer(data[at : at + TAG], f"{order}u4").tolist()
    if kind >> 16:
        kind, length, start, end = kind & 0xFFFF, kind >> 16, at + 4, at + TAG
        if length > 4:
            raise _refused(name, f"a small element of {length} bytes")
    else:
        start = at + TAG
        end = start + length + (-length % 8 if padded else 0)
    if start + length > len(data):
        raise _refused(name, f"an element of {length} bytes where {len(data) - start} are left")
    return _Element(kind, data[start : start + length], end)


def _refused(name: str, got: str) -> SourceError:
    return SourceError(name, "a MATLAB 5 file", got, "was it cut short? get it again")
