"""Masks as COCO run lengths (exact, 130 bytes) and as 1-bit PNG (exact, visible in any viewer)."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from pycocotools import mask as coco

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
FILTER_UP = 2


def encode_rle(masks: np.ndarray) -> list[bytes]:
    """(n, h, w) bool -> n compressed COCO counts."""
    columns = np.ascontiguousarray(masks.transpose(0, 2, 1)).view(np.uint8)
    return [rle["counts"] for rle in coco.encode(columns.transpose(2, 1, 0))]


def decode_rle(counts: Sequence[bytes | str], height: int, width: int) -> np.ndarray:
    """n compressed COCO counts -> (n, h, w) bool."""
    planes = coco.decode(_rles(counts, height, width))
    return np.ascontiguousarray(planes.transpose(2, 0, 1)).view(bool)


def boxes(counts: Sequence[bytes | str], height: int, width: int) -> list[list[int]]:
    """[x, y, width, height] in px of each mask, zeros for an empty one."""
    return coco.toBbox(_rles(counts, height, width)).astype(int).tolist()


def areas(counts: Sequence[bytes | str], height: int, width: int) -> list[int]:
    """Pixels of each mask."""
    return coco.area(_rles(counts, height, width)).tolist()


def _rles(counts: Sequence[bytes | str], height: int, width: int) -> list[dict]:
    return [{"size": [height, width], "counts": value} for value in counts]


def encode_png(mask: np.ndarray) -> bytes:
    """(h, w) bool -> a 1-bit grey PNG."""
    return _pack_png(mask) if mask.any() else empty_png(*mask.shape)


@lru_cache(maxsize=16)
def empty_png(height: int, width: int) -> bytes:
    """The PNG of a mask without a pixel; most samples have two."""
    return _pack_png(np.zeros((height, width), bool))


def _pack_png(mask: np.ndarray) -> bytes:
    rows = np.packbits(mask, axis=1)
    lines = np.full((rows.shape[0], rows.shape[1] + 1), FILTER_UP, np.uint8)
    lines[0, 1:] = rows[0]
    lines[1:, 1:] = rows[1:] - rows[:-1]
    header = struct.pack(">IIBBBBB", mask.shape[1], mask.shape[0], 1, 0, 0, 0, 0)
    body = zlib.compress(lines.tobytes(), 6)
    return PNG_SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", body) + _chunk(b"IEND", b"")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
