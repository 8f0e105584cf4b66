"""Protocol between the runner and the domain: how values split, what they contain and how they are stored.

The codec is injected as "module:attribute", the path of an object that satisfies `Codec`. Worker processes import it by that path,
and the runner stays free of domain code. `resolve` loads the object.

A codec determines the bytes of artifacts, so its code is part of every task's key. A codec that uses registries may have a method
`selects(names)`. It maps a field to a frozenset of the registry entries that values of these schemas use, and only those entries
count.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol


class Codec(Protocol):
    """Convert values to files and back.

    Pure: equal values have equal digests, on every machine.
    """

    def children(self, value: object) -> list[tuple[str, object]] | None:
        """Return the named parts of a composite value, None for a plain one.

        The parts are the elements of a tuple (named as shards, unique) or the fields of a bundle. A plain value is saved as
        one artifact.
        """

    def combine(self, kind: str, children: list[tuple[str, object]]) -> object:
        """Rebuild a composite value.

        `kind` is the result of `kind()` for the original value. A tuple ignores the names.
        """

    def kind(self, value: object) -> str:
        """Name of the schema ("Frames"); "tuple" for a tuple."""

    def digest(self, value: object) -> str:
        """Digest of the logical content of a plain value, independent of its layout and place on disk."""

    def save(self, value: object, folder: Path) -> None:
        """Write a plain value into an empty folder, as plain files (subfolders allowed).

        A symbolic link refers to a file that exists elsewhere. The file of a leaf stays there, any other becomes part of
        the store.
        """

    def load(self, kind: str, files: Mapping[str, Path]) -> object:
        """Load a plain value from its files: name relative to the saved folder -> verified, read-only path."""

    def schema_version(self, kind: str) -> str:
        """Digest of the field names and types of a schema; '' for a kind without fields ("tuple")."""


def resolve(reference: str) -> Any:
    """Import the object at "module:attribute"; ValueError for a string of another form."""
    module, colon, attribute = reference.partition(":")
    if not colon:
        raise ValueError(f"expected 'module:attribute', got {reference!r}")
    return getattr(importlib.import_module(module), attribute)
