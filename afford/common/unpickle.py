"""Read foreign pickles as data: an unpickler with an allow-list of opcodes and functions.

No name in a file is looked up or imported. A file can only call the functions that the reader lists, and every other name is
refused or becomes an inert `Opaque`. The base class is the pure-Python unpickler of the standard library, because the C version
allocates its memo by indices that a file states. Keys of dictionaries are scalars or flat tuples, which take linear time to hash.
"""

from __future__ import annotations

import io
import pickle
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from afford.common.bounded import PLAIN_KINDS, reason

OPCODES = (
    "PROTO FRAME STOP NONE NEWTRUE NEWFALSE BININT BININT1 BININT2 LONG1 LONG4 BINFLOAT BINUNICODE SHORT_BINUNICODE BINUNICODE8 "
    "BINSTRING SHORT_BINSTRING BINBYTES SHORT_BINBYTES BINBYTES8 EMPTY_LIST EMPTY_TUPLE EMPTY_DICT TUPLE TUPLE1 TUPLE2 TUPLE3 MARK "
    "BINPUT LONG_BINPUT MEMOIZE BINGET LONG_BINGET GLOBAL STACK_GLOBAL BINPERSID"
)
"""opcodes with the meaning of the standard library; `SafeUnpickler` defines those that call a function or change an object"""
MAX_OPCODES = 1 << 22
"""default limit; a checkpoint takes about 30 for a tensor"""
MAX_PLAIN_OPCODES = 1 << 28
"""limit of `load_plain`: annotations of a sequence have some million"""
SCALARS = (str, int, float, bool, type(None))
DAMAGED = (pickle.UnpicklingError, ValueError, TypeError, LookupError, AttributeError, EOFError, ArithmeticError, RuntimeError,
           MemoryError, struct.error, AssertionError)  # fmt: skip
"""exceptions of the standard library's unpickler for a damaged file"""


class RefusedError(ValueError):
    """A pickle is damaged, or contains something that its reader does not allow."""


class Opaque:
    """Inert stand-in for an object of a class that is not on the allow-list."""

    state: Any = None


@dataclass(frozen=True)
class Name:
    """A `module.attribute` in a pickle, and the function that stands for it."""

    name: str
    call: Callable[..., Any]


class SafeUnpickler(pickle._Unpickler):
    """Unpickler that calls nothing but `functions`, by their names in the file.

    With `opaque`, objects of other names become `Opaque`; without it, such names are refused. `references` resolves persistent ids.
    """

    stack: list[Any]
    append: Callable[[Any], None]
    read: Callable[[int], bytes]

    def __init__(self, data: bytes, functions: Mapping[str, Callable[..., Any]], *, opaque: bool = False,
                 references: Callable[[Any], Any] | None = None, max_opcodes: int = MAX_OPCODES) -> None:  # fmt: skip
        super().__init__(io.BytesIO(data), encoding="latin1")
        self.size, self.functions, self.opaque, self.references = len(data), functions, opaque, references
        self.max_opcodes = max_opcodes
        self.steps = 0

    def load(self) -> Any:
        """Contents of the pickle. RefusedError when it is damaged, too long, or contains something that is not allowed."""
        try:
            return super().load()
        except RefusedError:
            raise
        except DAMAGED as error:
            raise RefusedError(f"a pickle that is damaged or of another kind ({reason(error)})") from error

    def find_class(self, module: str, name: str) -> Name:
        """Function that the reader lists for a name; nothing is imported."""
        full = f"{module}.{name}"
        if full in self.functions:
            return Name(full, self.functions[full])
        if self.opaque:
            return Name(full, lambda *_: Opaque())
        raise RefusedError(full)

    def persistent_load(self, pid: Any) -> Any:
        """Object of a persistent id."""
        if self.references is None:
            raise RefusedError("a reference to something outside the pickle")
        return self.references(pid)

    def call(self) -> None:
        """REDUCE, NEWOBJ: call an allowed function."""
        arguments, function = self.stack.pop(), self.stack.pop()
        if not isinstance(function, Name):
            raise RefusedError(f"a call of a {type(function).__name__}")
        self.append(function.call(*arguments))

    def build(self) -> None:
        """BUILD: set the state of an array or an opaque object; other objects have none."""
        state, target = self.stack.pop(), self.stack[-1]
        if isinstance(target, (np.ndarray, np.dtype)):
            target.__setstate__(state)  # type: ignore[union-attr]  # numpy's types have none for a dtype
        elif isinstance(target, Opaque):
            target.state = state

    def extend(self, items: list[Any]) -> None:
        """APPEND, APPENDS, ADDITEMS."""
        target = self.stack[-1]
        if isinstance(target, list):
            target.extend(items)
        elif not isinstance(target, Opaque):
            raise RefusedError(f"items of a {type(target).__name__}")

    def set_items(self, items: list[Any]) -> None:
        """SETITEM, SETITEMS: items with other keys than scalars and flat tuples are refused, or dropped with `opaque`."""
        target = self.stack[-1]
        if not isinstance(target, (dict, Opaque)):
            raise RefusedError(f"items of a {type(target).__name__}")
        for key, value in zip(items[::2], items[1::2], strict=True):
            plain_key = isinstance(key, SCALARS) or (isinstance(key, tuple) and all(isinstance(part, SCALARS) for part in key))
            if not (plain_key or self.opaque):
                raise RefusedError(f"a key of type {type(key).__name__}")
            if plain_key and isinstance(target, dict):
                target[key] = value

    def byte_array(self) -> None:
        """BYTEARRAY8: no more bytes than the file has."""
        (count,) = struct.unpack("<Q", self.read(8))
        if count > self.size:
            raise RefusedError(f"a byte array of {count:,} bytes")
        self.append(bytearray(self.read(count)))

    def pop_one(self) -> list[Any]:
        """Top of the stack."""
        return [self.stack.pop()]

    def pop_two(self) -> list[Any]:
        """Key and value on top of the stack."""
        value, key = self.stack.pop(), self.stack.pop()
        return [key, value]


def _counted(step: Callable[[Any], Any]) -> Callable[[Any], None]:
    """Step of an opcode that counts towards the limit of the unpickler."""

    def run(unpickler: SafeUnpickler) -> None:
        unpickler.steps += 1
        if unpickler.steps > unpickler.max_opcodes:
            raise RefusedError(f"a pickle of more than {unpickler.max_opcodes:,} opcodes")
        step(unpickler)

    return run


def _code(name: str) -> int:
    code: int = getattr(pickle, name)[0]
    return code


SafeUnpickler.dispatch = {_code(name): _counted(pickle._Unpickler.dispatch[_code(name)]) for name in OPCODES.split()} | {
    _code(name): _counted(step) for name, step in {
        "REDUCE": SafeUnpickler.call, "NEWOBJ": SafeUnpickler.call, "BUILD": SafeUnpickler.build,
        "APPEND": lambda one: one.extend(one.pop_one()), "APPENDS": lambda one: one.extend(one.pop_mark()),
        "ADDITEMS": lambda one: one.extend(one.pop_mark()), "SETITEM": lambda one: one.set_items(one.pop_two()),
        "SETITEMS": lambda one: one.set_items(one.pop_mark()), "BYTEARRAY8": SafeUnpickler.byte_array,
        "EMPTY_SET": lambda one: one.append(one.find_class("builtins", "set").call())}.items()}  # fmt: skip


def load_plain(path: Path) -> Any:
    """Dictionaries, lists, numbers, text and numpy arrays of a pickle; torch tensors become arrays.

    RefusedError for everything else. Use it in a process with a memory limit: arrays may share data many times over.
    """
    loaded = SafeUnpickler(path.read_bytes(), PLAIN_FUNCTIONS, max_opcodes=MAX_PLAIN_OPCODES).load()
    try:
        return plain(loaded)
    except RecursionError as error:
        raise RefusedError("values that are nested too deeply") from error


def plain(value: Any) -> Any:
    """Copy of a tree of plain values; RefusedError for a tree with other values."""
    if isinstance(value, dict):
        return {plain(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return type(value)(plain(item) for item in value)
    if isinstance(value, SCALARS):
        return value
    if not hasattr(value, "__array__"):
        raise RefusedError(f"a {type(value).__name__}")
    found = np.asarray(value)
    if found.dtype.kind not in PLAIN_KINDS:
        raise RefusedError(f"an array of {found.dtype}")
    return found


def _frombuffer(data: Any, dtype: Any, shape: Any, order: str) -> np.ndarray:
    return np.frombuffer(data, dtype).reshape(shape, order=order)  # type: ignore[call-overload]  # "C" or "F", else ValueError


def _tensor(storage: Any, offset: int, size: tuple[int, ...], stride: tuple[int, ...], *_: Any) -> Any:
    import torch

    return torch.as_strided(torch.tensor([], dtype=storage.dtype).set_(storage), size, stride, offset)


def _storage(data: bytes) -> Any:
    """Storage of a tensor, which torch pickles as a file of its own."""
    import torch

    return torch.load(io.BytesIO(data), weights_only=True, map_location="cpu")


def _bytes(text: str, encoding: str) -> bytes:
    """Bytes as pickle protocol 2 writes them."""
    if encoding != "latin1":
        raise RefusedError(f"text in {encoding}")
    return text.encode(encoding)


CORES = ("core", "_core")
"""name of numpy's inner package before and since numpy 2"""
PLAIN_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "numpy.ndarray": lambda *_: np.empty(0, np.int8), "numpy.dtype": lambda kind, *_: np.dtype(kind, copy=True),
    "collections.OrderedDict": lambda *_: {}, "torch._utils._rebuild_tensor_v2": _tensor,
    "torch.storage._load_from_bytes": _storage, "_codecs.encode": _bytes,
    **{f"numpy.{core}.multiarray._reconstruct": lambda *_: np.empty(0, np.int8) for core in CORES},
    **{f"numpy.{core}.multiarray.scalar": lambda dtype, data: np.frombuffer(data, dtype)[0] for core in CORES},
    **{f"numpy.{core}.numeric._frombuffer": _frombuffer for core in CORES},
}  # fmt: skip
"""functions of plain pickles by the names that numpy and torch write"""
