"""Annotations that others publish as pickles, taken apart by a list of what may be in them: numbers, text, lists, arrays.

Nothing of a pickle is ever run but the makers of arrays and tensors named here; any other name is refused before it is looked up.
Use it in a process of its own only, as oakink2_import does: a damaged file may still crash or fill it.
"""

from __future__ import annotations

import io
import pickle
import struct
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

MAKERS = {("numpy", "ndarray"), ("numpy", "dtype"), ("collections", "OrderedDict"), ("torch._utils", "_rebuild_tensor_v2"),
          *((f"numpy.{core}.{part}", name) for core in ("core", "_core")
            for part, name in (("multiarray", "_reconstruct"), ("multiarray", "scalar"), ("numeric", "_frombuffer")))}  # fmt: skip
DAMAGED = (pickle.UnpicklingError, ValueError, TypeError, LookupError, AttributeError, EOFError, ArithmeticError, ImportError,
           RuntimeError, MemoryError, struct.error)  # fmt: skip
"""what Python's unpickler raises for a file that is damaged: any of these"""
PLAIN = (str, int, float, bool, type(None))


class NotPlainError(ValueError):
    """A pickle holds something that is no number, text, list or array."""


def load(path: Path) -> Any:
    """The dictionaries, lists, numbers, texts and numpy arrays of a pickle; tensors become arrays. NotPlainError for all else."""
    try:
        with path.open("rb") as file:
            return plain(Unpickler(file).load())
    except NotPlainError:
        raise
    except DAMAGED as error:
        raise NotPlainError(f"a damaged pickle ({type(error).__name__}: {error})") from error


def plain(value: Any) -> Any:
    """The same tree of plain values, or NotPlainError."""
    if isinstance(value, dict):
        return {plain(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(plain(item) for item in value)
    if isinstance(value, PLAIN):
        return value
    if not hasattr(value, "__array__"):
        raise NotPlainError(f"a {type(value).__name__}")
    found = np.asarray(value)
    if found.dtype.kind not in "biufSU":
        raise NotPlainError(f"an array of {found.dtype}")
    return found


class Unpickler(pickle.Unpickler):
    """Looks up nothing but MAKERS."""

    def __init__(self, file: BinaryIO) -> None:
        super().__init__(file, encoding="latin1")

    def find_class(self, module: str, name: str) -> Any:
        """What a pickle may call."""
        ours = {("torch.storage", "_load_from_bytes"): _storage, ("_codecs", "encode"): _encode}
        if (module, name) in ours:
            return ours[module, name]
        if (module, name) not in MAKERS:
            raise NotPlainError(f"{module}.{name}")
        return super().find_class(module, name)

    def persistent_load(self, pid: object) -> Any:
        """No pickle may point outside itself."""
        raise NotPlainError("a reference to something outside")


def _storage(data: bytes) -> Any:
    """The numbers of a tensor, which torch pickles as a file of its own."""
    import torch

    return torch.load(io.BytesIO(data), weights_only=True, map_location="cpu")


def _encode(text: str, encoding: str) -> bytes:
    """How Python 2 wrote bytes."""
    if encoding != "latin1":
        raise NotPlainError(f"text in {encoding}")
    return text.encode(encoding)
