"""Chunks of a PNG. OpenCV allocates what a chunk states before it looks whether the file has as much."""

from __future__ import annotations

from afford.readers.errors import SourceError

SIGNATURE = b"\x89PNG\r\n\x1a\n"
FRAME_BYTES = 12
"""of a chunk, beside its content: length, name, checksum"""


def check_chunks(data: bytes, name: str) -> None:
    """SourceError when `data` are a PNG that ends before a chunk of it does; data of other formats pass."""
    if not data.startswith(SIGNATURE):
        return
    at = len(SIGNATURE)
    while at < len(data):
        length = int.from_bytes(data[at : at + 4], "big")
        at += FRAME_BYTES + length
        if at > len(data):
            raise SourceError(name, "a whole PNG", f"one that ends {at - len(data)} bytes early", "get the file again")
        if data[at - FRAME_BYTES - length + 4 : at - FRAME_BYTES - length + 8] == b"IEND":
            return
