"""Tensors by name out of a file that torch wrote (a checkpoint, or TorchScript), of which nothing is run.

Such a file is a zip: one pickle that says what there is, and the numbers of each storage as a file of their own. The pickle is
read as data, one opcode after the other: no name in it is ever looked up, nothing is imported, and TorchScript's code is not
opened. What is no tensor (an optimiser, a callback of a trainer) becomes an `Opaque`. Safetensors are read by their own library.
Why: docs/decisions/018-read-weights-without-running-them.md.
"""

from __future__ import annotations

import pickle
import pickletools
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor

from afford.common.bounded import ZIP_ERRORS, read_member, reason

DTYPES = {"FloatStorage": torch.float32, "HalfStorage": torch.float16, "BFloat16Storage": torch.bfloat16,
          "DoubleStorage": torch.float64, "LongStorage": torch.int64, "IntStorage": torch.int32, "ShortStorage": torch.int16,
          "CharStorage": torch.int8, "ByteStorage": torch.uint8, "BoolStorage": torch.bool}  # fmt: skip
LOCAL_HEADER = struct.Struct("<26xHH")
"""of a file inside a zip: how long the name and the extra field are that follow it"""
LONGEST = 300
"""characters of a reason that a sentence gives"""
MAX_PICKLE_BYTES = 1 << 25
"""of the pickle in a checkpoint: it says 200 bytes a tensor, and what a trainer keeps beside them"""
MAX_OPCODES = 1 << 22
"""of that pickle: 30 a tensor"""
MAX_NAME = 4096
"""characters of a dotted name: beyond it mappings are nested without end"""
TORCH_ERRORS = (*ZIP_ERRORS, SafetensorError, pickle.UnpicklingError, AttributeError, TypeError, AssertionError, MemoryError)
"""what torch.load raises with weights_only for a file that is damaged or something else; it has no list of its own"""
WHAT = "a checkpoint or TorchScript as torch 1.6 and later write them, or safetensors"


class ForeignError(ValueError):
    """The file says something that a file of tensors does not say."""


class Name(str):
    """`module.attribute` of something that the file would have us call."""


class Opaque:
    """What the file builds of a class or function that we do not know, and do not look up."""

    def __init__(self, name: Any) -> None:
        self.name = name
        self.state: Any = None
        self.items: dict[Any, Any] = {}


def read_tensors(path: Path) -> dict[str, Tensor]:
    """Name -> tensor; those under `state_dict` when there is one. Memory of a zip is mapped, not read. ValueError says why not."""
    try:
        found = load_file(path) if path.suffix == ".safetensors" else dict(named(_read_zip(path)))
    except (*ZIP_ERRORS, SafetensorError) as error:
        raise ValueError(f"{path}: expected {WHAT}; {reason(error)[:LONGEST]}") from error
    if not found:
        raise ValueError(f"{path}: expected tensors by name, got none (a frozen TorchScript has lost them); save the state_dict")
    return found


def load_plain(path: Path, what: str) -> dict[str, Any]:
    """Mapping in a safetensors file, or in one that torch.load reads with weights_only, by name. A zip that unpacks to more than it
    is, as torch writes none, is refused. ValueError, one sentence, says why not; `what` is what was expected.
    """
    try:
        if path.suffix == ".safetensors":
            return dict(load_file(path))
        _check_stored(path)
        found = torch.load(path, map_location="cpu", weights_only=True)
    except TORCH_ERRORS as error:
        raise ValueError(f"{path}: expected {what}; {reason(error)[:LONGEST]}") from error
    if not isinstance(found, dict) or not all(isinstance(name, str) for name in found):
        raise ValueError(f"{path}: expected {what}; got no mapping of names to tensors")
    return dict(found)


def _check_stored(path: Path) -> None:
    """ForeignError when a zip has a member that is compressed, or a pickle of more than MAX_PICKLE_BYTES."""
    if not zipfile.is_zipfile(path):
        return
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            if info.compress_type != zipfile.ZIP_STORED or info.file_size != info.compress_size:
                raise ForeignError(f"got {info.filename} compressed")
            if info.filename.endswith(".pkl") and info.file_size > MAX_PICKLE_BYTES:
                raise ForeignError(f"got {info.filename} of {info.file_size >> 20} MiB")


def named(root: Any) -> Iterator[tuple[str, Tensor]]:
    """Every tensor in mappings and modules, with its dotted name; in a checkpoint those of `state_dict`."""
    root = root.get("state_dict", root) if isinstance(root, dict) else root
    seen: set[int] = set()
    waiting = [("", root)]
    while waiting:
        prefix, value = waiting.pop()
        if isinstance(value, Tensor):
            yield prefix[:-1], value
        if len(prefix) > MAX_NAME:
            raise ForeignError(f"got a name of more than {MAX_NAME} characters")
        inside = value.state if isinstance(value, Opaque) else value
        if isinstance(inside, dict) and id(inside) not in seen:
            seen.add(id(inside))
            waiting += [(f"{prefix}{key}.", item) for key, item in inside.items() if isinstance(key, str)]


def _read_zip(path: Path) -> Any:
    with zipfile.ZipFile(path) as archive:
        found = [name for name in archive.namelist() if name.endswith("/data.pkl") and name.count("/") == 1]
        if len(found) != 1:
            raise ForeignError(f"got a zip with {len(found)} files data.pkl")
        storages = Storages(path, archive, found[0].removesuffix(".pkl"))
        return Machine(storages).run(read_member(archive, archive.getinfo(found[0]), found[0], MAX_PICKLE_BYTES))


class Storages:
    """The numbers in the archive, each mapped from the file when it is asked for."""

    def __init__(self, path: Path, archive: zipfile.ZipFile, folder: str) -> None:
        self.path, self.archive, self.folder = path, archive, folder
        order = archive.NameToInfo.get(f"{folder.rpartition('/')[0]}/byteorder")
        if order is not None and read_member(archive, order, order.filename, len(b"little")) != b"little":
            raise ForeignError("got numbers in big-endian order")

    def __call__(self, pid: Any) -> Tensor:
        """(n,) tensor of what a persistent id means: ("storage", type, file, device, n)."""
        kind, dtype, key = pid[0], DTYPES.get(str(pid[1]).rpartition(".")[2]), f"{self.folder}/{pid[2]}"
        if kind != "storage" or dtype is None:
            raise ForeignError(f"got a {kind} of type {pid[1]}")
        info = self.archive.getinfo(key)
        if info.compress_type != zipfile.ZIP_STORED:
            raise ForeignError(f"got {key} compressed")
        if info.file_size == 0:
            return torch.empty(0, dtype=dtype)
        mapped = np.memmap(self.path, np.uint8, "c", self._start(info), (info.file_size,))
        return torch.from_numpy(mapped).view(dtype)

    def _start(self, info: zipfile.ZipInfo) -> int:
        with self.path.open("rb") as file:
            file.seek(info.header_offset)
            name, extra = LOCAL_HEADER.unpack(file.read(LOCAL_HEADER.size))
        return info.header_offset + LOCAL_HEADER.size + name + extra


class Machine:
    """A stack and a memo that follow the opcodes of a pickle, as far as files of tensors have them. Calls nothing by name."""

    def __init__(self, storages: Storages) -> None:
        self.storages = storages
        self.stack: list[Any] = []
        self.marks: list[int] = []
        self.memo: dict[int, Any] = {}

    def run(self, data: bytes) -> Any:
        """What the pickle describes; ForeignError at an opcode or call that no file of tensors has."""
        try:
            for count, (opcode, argument, _) in enumerate(pickletools.genops(data)):
                if count > MAX_OPCODES:
                    raise ForeignError(f"the pickle inside has more than {MAX_OPCODES:,} opcodes")
                if opcode.name == "STOP":
                    return self.stack.pop()
                self._step(opcode.name, argument)
        except (ValueError, LookupError, TypeError, AttributeError, OverflowError, struct.error) as error:
            raise ForeignError(f"the pickle inside is damaged or of another kind ({reason(error)})") from error
        raise ForeignError("the pickle inside has no end")

    def _step(self, name: str, argument: Any) -> None:
        if name in PUSHES:
            self.stack.append(PUSHES[name](argument))
        elif name in PUTS:
            self.memo[len(self.memo) if argument is None else argument] = self.stack[-1]
        elif name in GETS:
            self.stack.append(self.memo[argument])
        elif name in TUPLES:
            self.stack.append(tuple(self._pop(TUPLES[name])))
        elif name in ACTIONS:
            ACTIONS[name](self)
        elif name not in NOTHING:
            raise ForeignError(f"got the opcode {name}")

    def _pop(self, count: int) -> list[Any]:
        taken = self.stack[len(self.stack) - count :]
        if len(taken) != count:
            raise ForeignError("takes more than it has")
        del self.stack[len(self.stack) - count :]
        return taken

    def _since_mark(self) -> list[Any]:
        return self._pop(len(self.stack) - self.marks.pop())

    def mark(self) -> None:
        """MARK"""
        self.marks.append(len(self.stack))

    def close_tuple(self) -> None:
        """TUPLE"""
        self.stack.append(tuple(self._since_mark()))

    def append(self) -> None:
        """APPEND"""
        self._append(self._pop(1))

    def extend(self) -> None:
        """APPENDS"""
        self._append(self._since_mark())

    def set_one(self) -> None:
        """SETITEM"""
        self._set(self._pop(2))

    def set_all(self) -> None:
        """SETITEMS"""
        self._set(self._since_mark())

    def name_thing(self) -> None:
        """STACK_GLOBAL"""
        self.stack.append(Name(".".join(map(str, self._pop(2)))))

    def map_storage(self) -> None:
        """BINPERSID"""
        self.stack.append(self.storages(self.stack.pop()))

    def leave_object(self) -> None:
        """NEWOBJ"""
        self.stack.append(Opaque(self._pop(2)[0]))

    def make(self) -> None:
        """REDUCE"""
        what, arguments = self._pop(2)
        self.stack.append(_made(what, arguments))

    def keep_state(self) -> None:
        """BUILD"""
        state = self.stack.pop()
        if isinstance(self.stack[-1], Opaque):
            self.stack[-1].state = state

    def _append(self, values: list[Any]) -> None:
        if isinstance(self.stack[-1], list):
            self.stack[-1].extend(values)

    def _set(self, values: list[Any]) -> None:
        target = self.stack[-1].items if isinstance(self.stack[-1], Opaque) else self.stack[-1]
        if not isinstance(target, dict):
            raise ForeignError("sets items of what has none")
        target.update({key: value for key, value in zip(values[::2], values[1::2], strict=True) if isinstance(key, str)})


PUSHES: dict[str, Any] = {
    **dict.fromkeys(("BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8", "BININT", "BININT1", "BININT2", "LONG1", "LONG4", "BINFLOAT",
                     "BINSTRING", "SHORT_BINSTRING", "BINBYTES", "SHORT_BINBYTES", "BINBYTES8"), lambda said: said),
    "NONE": lambda _: None, "NEWTRUE": lambda _: True, "NEWFALSE": lambda _: False, "EMPTY_DICT": lambda _: {},
    "EMPTY_LIST": lambda _: [], "EMPTY_TUPLE": lambda _: (), "EMPTY_SET": lambda _: Opaque("set"),
    "GLOBAL": lambda said: Name(said.replace(" ", ".")),
}  # fmt: skip
PUTS, GETS = ("BINPUT", "LONG_BINPUT", "MEMOIZE"), ("BINGET", "LONG_BINGET")
TUPLES = {"TUPLE1": 1, "TUPLE2": 2, "TUPLE3": 3}
NOTHING = ("PROTO", "FRAME")
ACTIONS = {"MARK": Machine.mark, "TUPLE": Machine.close_tuple, "APPEND": Machine.append, "APPENDS": Machine.extend,
           "SETITEM": Machine.set_one, "SETITEMS": Machine.set_all, "STACK_GLOBAL": Machine.name_thing,
           "BINPERSID": Machine.map_storage, "NEWOBJ": Machine.leave_object, "REDUCE": Machine.make,
           "BUILD": Machine.keep_state}  # fmt: skip


def _made(what: Any, arguments: Any) -> Any:
    """What a call in the file stands for: a tensor, a parameter, a mapping, or something that we leave alone."""
    if what == "torch._utils._rebuild_tensor_v2":
        storage, offset, size, stride = arguments[:4]
        return torch.as_strided(storage, size, stride, offset)
    if what == "torch._utils._rebuild_parameter":
        return arguments[0]
    return {} if what == "collections.OrderedDict" else Opaque(what)
