"""Nouns of a toy domain, and their codec."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Word:
    """A named text."""

    name: str
    text: str


@dataclass(frozen=True)
class Pair:
    """A bundle of two words."""

    left: Word
    right: Word


@dataclass(frozen=True)
class Outside:
    """File outside the store."""

    name: str
    digest: str
    path: Path


class ToyCodec:
    """See runner.codec.Codec."""

    def children(self, value: object) -> list[tuple[str, object]] | None:
        if isinstance(value, tuple):
            return [(item.name, item) for item in value]
        return [("left", value.left), ("right", value.right)] if isinstance(value, Pair) else None

    def combine(self, kind: str, children: list[tuple[str, object]]) -> object:
        return tuple(value for _, value in children) if kind == "tuple" else Pair(**dict(children))  # type: ignore[arg-type]

    def kind(self, value: object) -> str:
        return type(value).__name__

    def digest(self, value: object) -> str:
        content = [self.kind(value), value.name, value.digest if isinstance(value, Outside) else value.text]
        return hashlib.sha256(json.dumps(content).encode()).hexdigest()

    def save(self, value: object, folder: Path) -> None:
        if isinstance(value, Outside):
            (folder / "name").write_text(value.name)
            (folder / "file").symlink_to(value.path)
        elif value.text == "full disk":
            raise OSError(28, "No space left on device")
        else:
            (folder / "word.json").write_text(json.dumps([value.name, value.text]))

    def load(self, kind: str, files: Mapping[str, Path]) -> object:
        if kind == "Outside":
            return Outside(files["name"].read_text(), "", files["file"])
        return Word(*json.loads(files["word.json"].read_text()))

    def schema_version(self, kind: str) -> str:
        return "" if kind == "tuple" else f"{kind} 1"


CODEC = ToyCodec()
