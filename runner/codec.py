"""What the runner must know about values, and cannot: how they split, what they contain, how they lie on disk.

The codec is injected as "module:attribute" (an object that fits `Codec`), so that worker processes can import it and the
runner knows nothing of the domain. `resolve` turns such a string into the object.

A codec decides bytes, so its code is in the key of every task. One that keeps parts of itself in a registry may have a method
`selects(names)`: field -> entries (a frozenset) of the registries that values of schemas of these names use. Only those count.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol


class Codec(Protocol):
    """Values to files and back. Pure: equal values give equal digests, on every machine."""

    def children(self, value: object) -> list[tuple[str, object]] | None:
        """Named parts of a composite value: the elements of a tuple (named as shards, unique), the fields of a bundle;
        None for a plain value, which is saved as one artifact.
        """

    def combine(self, kind: str, children: list[tuple[str, object]]) -> object:
        """The composite value again; `kind` is what `kind()` said of it. A tuple ignores the names."""

    def kind(self, value: object) -> str:
        """Name of the schema ("Frames"); "tuple" for a tuple."""

    def digest(self, value: object) -> str:
        """Digest of the logical content of a plain value: independent of how it is laid out on disk or where it lies."""

    def save(self, value: object, folder: Path) -> None:
        """Write a plain value into an empty folder, as plain files (subfolders allowed). A symbolic link stands for a file
        that exists elsewhere: it stays there when the value is a leaf, and becomes part of the store otherwise.
        """

    def load(self, kind: str, files: Mapping[str, Path]) -> object:
        """A plain value from its files: name relative to the saved folder -> verified, read-only path."""

    def schema_version(self, kind: str) -> str:
        """Digest of the field names and types of a schema; '' for a kind that has none ("tuple")."""


def resolve(reference: str) -> Any:
    """The object that "module:attribute" names; ValueError when the string is not of that form."""
    module, colon, attribute = reference.partition(":")
    if not colon:
        raise ValueError(f"expected 'module:attribute', got {reference!r}")
    return getattr(importlib.import_module(module), attribute)
