"""Every schema by name, and what its fields are: the one place that knows which nouns exist."""

from __future__ import annotations

import dataclasses
import functools
import json
from collections.abc import Iterable

from blake3 import blake3

from schemas.catalogue import SCHEMAS
from schemas.spec import Schema

BUNDLES = ("PartedMesh", "ReadMesh", "RenderedClip", "RenderedInteraction", "Trained", "TwoTasksShown")
"""schemas whose fields are artifacts of their own, so that a stage may depend on one of them alone"""

SHELVES = {"Samples": "samples"}
"""schema -> its field that is a long list of large elements, which loading leaves on disk (`codecs/shelf.py`)"""


@functools.cache
def kinds() -> dict[str, type[Schema]]:
    """Schema name -> class."""
    return {schema.__name__: schema for schema in SCHEMAS}


def encodings(names: Iterable[str]) -> set[str]:
    """How fields of these schemas are laid out on disk; other names are passed over."""
    found = [kinds()[name] for name in names if name in kinds()]
    return {field.metadata.get("encoding", "raw") for kind in found for field in dataclasses.fields(kind)}  # type: ignore[arg-type]


def kind_of(value: object) -> str:
    """'tuple', or the name of the schema; TypeError for anything else."""
    if isinstance(value, tuple):
        return "tuple"
    if type(value).__name__ not in kinds():
        raise TypeError(f"expected a schema of schemas/ or a tuple of them, got {type(value).__name__}")
    return type(value).__name__


def shard_name(value: object) -> str:
    """Label of one element of a list: its clip, its name, its video; a bundle has the label of its first field."""
    for attribute in ("clip_id", "name", "video_id"):
        if isinstance(label := getattr(value, attribute, None), str):
            return label
    if type(value).__name__ in BUNDLES:
        return shard_name(getattr(value, dataclasses.fields(value)[0].name))  # type: ignore[arg-type]  # bundles are dataclasses
    raise TypeError(f"{type(value).__name__} has no clip_id, name or video_id to label it in a list")


@functools.cache
def schema_version(kind: str) -> str:
    """Digest of the names, types, shapes and dtypes of a schema and of those it contains; '' for 'tuple'."""
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
