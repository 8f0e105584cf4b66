"""Base of all schemas: frozen dataclasses whose array fields declare shape, dtype, unit and frame, checked on construction.

Array fields are declared with `array`, other fields with `value`. A shape is written as words: a number is exact, a name has
the same size everywhere in one object (``"t h w 3"``), ``*`` is any size. `encoding` selects the storage format of the field;
it does not change its meaning, so it is not part of a schema's version.
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
"""number of items of a tuple, and of characters of other values, in a repr"""


class SchemaError(ValueError):
    """Error for a value that does not fit its schema; the message names the field, the expected and the actual value."""


def array(shape: str, dtype: str, doc: str, *, unit: str = "", frame: str = "", encoding: Encoding = "raw") -> Any:
    """Declare a numpy field: `shape` in words ("n t h w"), `dtype` as a numpy name.

    Encodings: `raw` safetensors, `video` lossless H.264 of (t, h, w, 3) uint8, `rle` COCO run lengths of (..., h, w) bool,
    `zstd` compressed raw bytes.
    """
    meta = {"shape": shape, "dtype": dtype, "doc": doc, "unit": unit, "frame": frame, "encoding": encoding}
    return dataclasses.field(metadata=meta)


def value(doc: str, *, unit: str = "", frame: str = "", default: Any = MISSING) -> Any:
    """Declare a plain field: str, int, float, bool, tuple, another schema, or None."""
    return dataclasses.field(default=default, metadata={"doc": doc, "unit": unit, "frame": frame})


class Schema:
    """Base class of all schemas. Checks the declared shapes and dtypes of array fields on construction."""

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


class Bundle(Schema):
    """Base class of schemas whose fields are artifacts of their own, so that a stage may depend on one of them alone."""


def _short(found: Any) -> str:
    """Return a readable form of a value: the shape of an array, the length of a long tuple, the name of a nested schema."""
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
    """Context of a running stage, passed to a `run` whose last parameter is `ctx`."""

    @property
    def scratch(self) -> Path:
        """Private folder of this key, which survives a kill and is deleted once the output is stored."""

    def progress(self, done: int, total: int) -> None:
        """Report progress: done and total units of work."""
