"""Canonical, tagged pre-images and their digests, of which keys are made."""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from blake3 import blake3

CHUNK_BYTES = 1 << 22
ENCODER = json.JSONEncoder(sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)


def canonical(value: object) -> Any:
    """Convert a value to JSON types.

    Strings, integers, booleans and None stay. A float becomes its shortest exact decimal, a sequence a list, a dataclass its
    class name and fields. TypeError for anything else.
    """
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else {"float": repr(value)}
    if isinstance(value, (tuple, list)):
        return [canonical(item) for item in value]
    if isinstance(value, Mapping):
        return {"map": sorted([str(key), canonical(item)] for key, item in value.items())}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {item.name: canonical(getattr(value, item.name)) for item in dataclasses.fields(value)}
        return {"of": type(value).__name__, "fields": fields}
    raise TypeError(f"expected str, int, float, bool, None, a tuple or a dataclass of them, got {type(value).__name__}")


def dumps(tree: Any) -> str:
    """Serialise a JSON tree in its one canonical form: sorted keys, no spaces, ASCII."""
    return ENCODER.encode(tree)


def digest(tag: str, tree: Any) -> str:
    """Hex digest of a JSON tree under a tag, which keeps digests of different kinds apart."""
    return blake3(f"{tag}\0{dumps(tree)}".encode()).hexdigest()


def path_digest(path: Path) -> str:
    """Hex digest of a file, or of the names and bytes of a folder of plain files.

    OSError for a folder with anything but plain files (links included) and for pipes, sockets and devices, which block when
    read.
    """
    if path.is_file():
        return file_digest(path)
    if path.exists() and not path.is_dir():
        raise OSError(f"{path}: expected a file or a folder, got a pipe, a socket or a device; remove it")
    rows = []
    with os.scandir(path) as found:
        for item in sorted(found, key=lambda item: item.name):
            if not item.is_file(follow_symlinks=False):
                raise OSError(f"{path}: expected plain files, got {item.name}, which is a folder or a link; remove it")
            rows.append([item.name, file_digest(Path(item.path))])
    return digest("afford-folder", rows)


def file_digest(path: Path) -> str:
    """Hex digest of the bytes of a file."""
    hasher = blake3()
    with path.open("rb") as stream:
        while chunk := stream.read(CHUNK_BYTES):
            hasher.update(chunk)
    return hasher.hexdigest()
