"""Zeros by the gigabyte in a few megabytes, made without packing gigabytes: one packed block, many times."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

BLOCK = 1_000_000


def deflated(head: bytes, zeros: int) -> bytes:
    """A raw deflate stream of `head` and so many zeros after it."""
    pack = zlib.compressobj(9, zlib.DEFLATED, -15)
    first = pack.compress(head) + pack.flush(zlib.Z_FULL_FLUSH)
    block = pack.compress(bytes(BLOCK)) + pack.flush(zlib.Z_FULL_FLUSH)
    return first + block * (zeros // BLOCK) + pack.compress(bytes(zeros % BLOCK)) + pack.flush()


def zlib_stream(head: bytes, zeros: int) -> bytes:
    """The same with the header and the checksum of zlib."""
    a, b = zlib.adler32(head) & 0xFFFF, zlib.adler32(head) >> 16
    check = ((b + zeros * a) % 65521) << 16 | a
    return b"\x78\xda" + deflated(head, zeros) + check.to_bytes(4, "big")


def zip_of(path: Path, name: str, head: bytes, zeros: int, stated: int) -> Path:
    """A zip of one file of `head` and zeros, whose size it states as `stated`; the checksum is that of nothing."""
    packed, called = deflated(head, zeros), name.encode()
    sizes = (0, len(packed), stated, len(called), 0)
    local = struct.pack("<4s5H3I2H", b"PK\3\4", 20, 0, 8, 0, 33, *sizes) + called
    entry = struct.pack("<4s6H3I5H2I", b"PK\1\2", 20, 20, 0, 8, 0, 33, *sizes, 0, 0, 0, 0, 0) + called
    end = struct.pack("<4s4H2IH", b"PK\5\6", 0, 0, 1, 1, len(entry), len(local) + len(packed), 0)
    path.write_bytes(local + packed + entry + end)
    return path


def black_png(width: int, height: int, bits: int = 8) -> bytes:
    """A black grey PNG, as small as it can be."""
    data = zlib_stream(b"", height * (1 + width * bits // 8))
    chunks = ((b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)), (b"IDAT", data), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        len(part).to_bytes(4, "big") + kind + part + zlib.crc32(kind + part).to_bytes(4, "big") for kind, part in chunks)
