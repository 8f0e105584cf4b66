"""Codec between schema values and files: the domain knowledge that the runner needs (`runner.codec.Codec`)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

from afford.codecs.kinds import digest, encodings, kind_of, kinds, schema_version, shard_name
from afford.codecs.pools import DECODERS, ENCODERS
from afford.codecs.structure import load, load_folder, save
from schemas.spec import Bundle

__all__ = ["CODEC", "SchemaCodec", "digest", "load", "load_folder", "save"]


class SchemaCodec:
    """Codec of all schemas in `schemas/`; see `runner.codec.Codec` for the contract of each method."""

    def children(self, value: object) -> list[tuple[str, object]] | None:
        """Return the elements of a tuple by shard name, the fields of a bundle by name, or None for a plain schema."""
        if isinstance(value, tuple):
            return [(shard_name(item), item) for item in value]
        if isinstance(value, Bundle):
            return [(f.name, getattr(value, f.name)) for f in dataclasses.fields(value)]  # type: ignore[arg-type]  # a dataclass
        return None

    def combine(self, kind: str, children: list[tuple[str, object]]) -> object:
        """Rebuild a tuple or bundle from its children."""
        return tuple(item for _, item in children) if kind == "tuple" else kinds()[kind](**dict(children))

    def kind(self, value: object) -> str:
        """Return 'tuple' or the name of the schema."""
        return kind_of(value)

    def digest(self, value: object) -> str:
        """Return the content digest of a plain value."""
        return digest(value)

    def save(self, value: object, folder: Path) -> None:
        """Write a plain value into an empty folder."""
        save(value, folder)

    def load(self, kind: str, files: Mapping[str, Path]) -> object:
        """Read a plain value."""
        return load(kind, files)

    def schema_version(self, kind: str) -> str:
        """Return the digest of the fields of a schema."""
        return schema_version(kind)

    def selects(self, names: frozenset[str]) -> dict[str, frozenset[str]]:
        """Return the field encodings of these schemas that are entries of a registry (`runner.codec`)."""
        found = frozenset(encodings(names) & {*ENCODERS, *DECODERS})
        return {"encoder": found, "decoder": found}


CODEC = SchemaCodec()
