"""How a noun of afford describes itself: shape, dtype, unit and frame on every field, checked when it is built.

A noun is a frozen dataclass that derives from `Schema`. Its array fields are declared with `array`, everything else with
`value`. Shapes are written as words: a number is exact, a name must mean the same size everywhere in one object
(``"t h w 3"``), ``*`` is any size. `encoding` tells the codecs how the field is laid out on disk; it never changes what the
field means, so it is not part of a schema's version.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

if TYPE_CHECKING:
    import numpy as np

Encoding = Literal["raw", "video", "rle", "zstd"]
MISSING = dataclasses.MISSING
SHOWN, WORDS = 4, 60
"""items of a tuple, characters of anything else, that a repr shows"""


class SchemaError(ValueError):
    """A value does not fit its schema; the message names the field, what was expected and what was found."""


def array(shape: str, dtype: str, doc: str, *, unit: str = "", frame: str = "", encoding: Encoding = "raw") -> Any:
    """A numpy field. `shape` is words ("n t h w"), `dtype` a numpy name; encodings: `raw` safetensors, `video` lossless
    H.264 of (t, h, w, 3) uint8, `rle` COCO run lengths of (..., h, w) bool, `zstd` compressed raw bytes.
    """
    meta = {"shape": shape, "dtype": dtype, "doc": doc, "unit": unit, "frame": frame, "encoding": encoding}
    return dataclasses.field(metadata=meta)


def value(doc: str, *, unit: str = "", frame: str = "", default: Any = MISSING) -> Any:
    """A plain field: str, int, float, bool, tuple, another schema, or None."""
    return dataclasses.field(default=default, metadata={"doc": doc, "unit": unit, "frame": frame})


class Schema:
    """Base of every noun: checks its arrays against their declared shapes and dtypes when it is built, and prints them as those."""

    def __init_subclass__(cls) -> None:
        if "__repr__" not in cls.__dict__:
            cls.__repr__ = Schema.__repr__  # type: ignore[method-assign]  # a dataclass would write one that prints whole arrays

    def __repr__(self) -> str:
        fields = dataclasses.fields(self)  # type: ignore[arg-type]  # every subclass is a dataclass
        return f"{type(self).__name__}({', '.join(f'{one.name}={_short(getattr(self, one.name))}' for one in fields)})"

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for field in dataclasses.fields(self):  # type: ignore[arg-type]  # every subclass is a dataclass
            if "shape" in field.metadata:
                _check_array(type(self).__name__, field.name, getattr(self, field.name), field.metadata, sizes)


def _short(found: Any) -> str:
    """A value as one reads it: the shape of an array, the length of a long tuple, the name of a noun within a noun."""
    if hasattr(found, "dtype") and hasattr(found, "shape"):
        return f"{found.dtype} {tuple(found.shape)}"
    if isinstance(found, Schema):
        name = getattr(found, "name", "")
        return f"{type(found).__name__}({repr(name) if isinstance(name, str) and name else '...'})"
    if isinstance(found, tuple | bytes) and len(found) > SHOWN:
        return f"{len(found)} {'bytes' if isinstance(found, bytes) else 'items'}"
    if isinstance(found, tuple):
        return f"({', '.join(map(_short, found))}{',' if len(found) == 1 else ''})"
    words = repr(found)
    return words if len(words) <= WORDS else f"{words[: WORDS - 4]}...{words[-1]}"


def _check_array(owner: str, name: str, found: np.ndarray, meta: Any, sizes: dict[str, int]) -> None:
    words = meta["shape"].split()
    label = f"{owner}.{name}: expected {meta['dtype']} ({' '.join(words)})"
    if not hasattr(found, "dtype"):
        raise SchemaError(f"{label}, got {type(found).__name__}")
    if found.dtype != meta["dtype"] or found.ndim != len(words):
        raise SchemaError(f"{label}, got {found.dtype} {found.shape}")
    for word, size in zip(words, found.shape, strict=True):
        want = int(word) if word.isdigit() else size if word == "*" else sizes.setdefault(word, size)
        if size != want:
            raise SchemaError(f"{label} with {word}={want}, got {found.dtype} {found.shape}")


class Context(Protocol):
    """Handed to a stage whose `run` has a last parameter `ctx`."""

    @property
    def scratch(self) -> Path:
        """A private folder of this key: it survives a kill and is deleted when the output is safe."""

    def progress(self, done: int, total: int) -> None:
        """Say how far the work is."""
