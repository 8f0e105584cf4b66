"""The content digest of a value: what it means, not how it lies on disk.

A canonical walk: every part is written with a tag and a length, so that two different values never feed the hash the same bytes.
A file is its name and its digest; where it can be read on this machine does not count.
"""

from __future__ import annotations

import dataclasses
import struct
from pathlib import Path

import numpy as np
from blake3 import blake3

from afford.codecs.shelf import Shelf


def digest(value: object) -> str:
    """Hex digest of a schema, tuple, array, str, int, float, bool or None; TypeError for anything else."""
    hasher = blake3()
    _feed(hasher, value)
    return hasher.hexdigest()


def _feed(hasher: blake3, value: object) -> None:
    if isinstance(value, np.ndarray):
        _tag(hasher, "array", f"{value.dtype.str}{value.shape}".encode())
        hasher.update(np.ascontiguousarray(value).reshape(-1).view(np.uint8).data if value.size else b"")
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [field for field in dataclasses.fields(value) if field.type != "Path"]
        _tag(hasher, "schema", f"{type(value).__name__}:{len(fields)}".encode())
        for field in fields:
            _tag(hasher, "field", field.name.encode())
            _feed(hasher, getattr(value, field.name))
    elif isinstance(value, (tuple, Shelf)):
        _tag(hasher, "tuple", str(len(value)).encode())
        for item in value:
            _feed(hasher, item)
    else:
        _tag(hasher, *_scalar(value))


def _scalar(value: object) -> tuple[str, bytes]:
    if value is None or isinstance(value, bool):
        return "word", str(value).encode()
    if isinstance(value, str):
        return "str", value.encode("utf-8", "surrogatepass")
    if isinstance(value, int):
        return "int", str(int(value)).encode()
    if isinstance(value, float):
        return "float", struct.pack("<d", value)
    hint = ": keep paths in FileRef" if isinstance(value, Path) else ""
    raise TypeError(f"no content digest for a {type(value).__name__}{hint}")


def _tag(hasher: blake3, tag: str, data: bytes) -> None:
    hasher.update(f"{tag}:{len(data)}:".encode() + data)
