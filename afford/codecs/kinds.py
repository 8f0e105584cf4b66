"""Registry of schemas by name, their versions, and the content digest of a value.

The content digest does not depend on the file format. Every part of a value is hashed with a tag and a length, so that
different values never produce the same bytes. A file is hashed as its name and its digest, without its path.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, overload

import numpy as np
from blake3 import blake3

from schemas.catalogue import SCHEMAS
from schemas.spec import Bundle, Schema


class LazyTuple(Sequence[Any]):
    """Lazy tuple field of a stored value. Every iteration reads the files again and yields new, equal elements."""

    def __init__(self, length: int, read: Callable[[], Iterator[Any]], files: tuple[Path, ...]) -> None:
        self._length, self._read = length, read
        self.files = files
        """files that an iteration opens"""

    def __len__(self) -> int:
        return self._length

    def __iter__(self) -> Iterator[Any]:
        return self._read()

    @overload
    def __getitem__(self, at: int) -> Any: ...
    @overload
    def __getitem__(self, at: slice) -> tuple[Any, ...]: ...

    def __getitem__(self, at: int | slice) -> Any:
        if isinstance(at, slice):
            wanted = range(self._length)[at]
            found = {i: item for i, item in enumerate(self) if i in wanted}
            return tuple(found[i] for i in wanted)
        return next(islice(self, range(self._length)[at], None))


def digest(value: object) -> str:
    """Return the hex digest of a schema, tuple, array, str, int, float, bool or None. Raises TypeError for other types."""
    hasher = blake3()
    _hash_value(hasher, value)
    return hasher.hexdigest()


def _hash_value(hasher: blake3, value: object) -> None:
    if isinstance(value, np.ndarray):
        _hash_tagged(hasher, "array", f"{value.dtype.str}{value.shape}".encode())
        hasher.update(np.ascontiguousarray(value).reshape(-1).view(np.uint8).data if value.size else b"")
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = [field for field in dataclasses.fields(value) if field.type != "Path"]
        _hash_tagged(hasher, "schema", f"{type(value).__name__}:{len(fields)}".encode())
        for field in fields:
            _hash_tagged(hasher, "field", field.name.encode())
            _hash_value(hasher, getattr(value, field.name))
    elif isinstance(value, (tuple, LazyTuple)):
        _hash_tagged(hasher, "tuple", str(len(value)).encode())
        for item in value:
            _hash_value(hasher, item)
    else:
        _hash_tagged(hasher, *_scalar(value))


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


def _hash_tagged(hasher: blake3, tag: str, data: bytes) -> None:
    hasher.update(f"{tag}:{len(data)}:".encode() + data)


LAZY_FIELDS = {"Samples": "samples"}
"""schema -> field with a long list of large elements, which loading leaves on disk (`LazyTuple`)"""


@functools.cache
def kinds() -> dict[str, type[Schema]]:
    """Return the schema classes by name."""
    return {schema.__name__: schema for schema in SCHEMAS}


def encodings(names: Iterable[str]) -> set[str]:
    """Return the encodings of the fields of these schemas; unknown names are ignored."""
    found = [kinds()[name] for name in names if name in kinds()]
    return {field.metadata.get("encoding", "raw") for kind in found for field in dataclasses.fields(kind)}  # type: ignore[arg-type]


def kind_of(value: object) -> str:
    """Return 'tuple' or the name of the schema. Raises TypeError for other types."""
    if isinstance(value, tuple):
        return "tuple"
    if type(value).__name__ not in kinds():
        raise TypeError(f"expected a schema of schemas/ or a tuple of them, got {type(value).__name__}")
    return type(value).__name__


def shard_name(value: object) -> str:
    """Return the label of a list element: its clip, name or video; a bundle has the label of its first field."""
    for attribute in ("clip_id", "name", "video_id"):
        if isinstance(label := getattr(value, attribute, None), str):
            return label
    if isinstance(value, Bundle):
        return shard_name(getattr(value, dataclasses.fields(value)[0].name))  # type: ignore[arg-type]  # bundles are dataclasses
    raise TypeError(f"{type(value).__name__} has no clip_id, name or video_id to label it in a list")


@functools.cache
def schema_version(kind: str) -> str:
    """Return the digest of names, types, shapes and dtypes of a schema and of the schemas it contains; '' for 'tuple'."""
    if kind == "tuple":
        return ""
    seen: dict[str, list[list[str]]] = {}
    _describe(kind, seen)
    return blake3(json.dumps(seen, sort_keys=True).encode()).hexdigest(16)


def _describe(kind: str, seen: dict[str, list[list[str]]]) -> None:
    if kind in seen:
        return
    fields = dataclasses.fields(kinds()[kind])  # type: ignore[arg-type]  # every schema is a dataclass
    seen[kind] = [[f.name, str(f.type), f.metadata.get("shape", ""), f.metadata.get("dtype", "")] for f in fields]
    for other in kinds():
        if any(other in str(f.type) for f in fields):
            _describe(other, seen)
