"""Tagged, canonical pre-images and their digests: everything that goes into a key passes through here."""

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
    """`value` as JSON types: str, int, bool and None as they are, floats by their shortest exact decimal, sequences as
    lists, dataclasses as their class name and fields; TypeError for anything else.
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
    """One spelling per tree: sorted keys, no spaces, ASCII."""
    return ENCODER.encode(tree)


def digest(tag: str, tree: Any) -> str:
    """Hex digest of a JSON tree under a tag, so that two sorts of things never share a digest."""
    return blake3(f"{tag}\0{dumps(tree)}".encode()).hexdigest()


def path_digest(path: Path) -> str:
    """Hex digest of a file, or of a folder of plain files: of their names and bytes. OSError when a folder holds anything else,
    links above all, and for what is neither: reading a pipe waits for ever.
    """
    if path.is_file():
        return file_digest(path)
    if path.exists() and not path.is_dir():
        raise OSError(f"{path}: expected a file or a folder, got a pipe, a socket or a device; take it out")
    rows = []
    with os.scandir(path) as found:
        for item in sorted(found, key=lambda item: item.name):
            if not item.is_file(follow_symlinks=False):
                raise OSError(f"{path}: expected plain files, got {item.name}, which is a folder or a link; take it out")
            rows.append([item.name, file_digest(Path(item.path))])
    return digest("afford-folder", rows)


def file_digest(path: Path) -> str:
    """Hex digest of the bytes of a file."""
    hasher = blake3()
    with path.open("rb") as stream:
        while chunk := stream.read(CHUNK_BYTES):
            hasher.update(chunk)
    return hasher.hexdigest()
