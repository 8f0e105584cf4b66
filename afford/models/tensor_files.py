"""Read tensors by name from checkpoints, TorchScript and safetensors, without running code from the file.

A file of torch is a zip archive: one pickle that describes the contents, and one member for the numbers of each storage. The pickle
is read with the allow-list of `afford.common.unpickle`: objects that are not tensors, such as an optimizer or a callback of a
trainer, become inert, and the code of a TorchScript is not opened. Numbers are memory-mapped.
Reasons: docs/decisions/018-read-weights-without-running-them.md.
"""

from __future__ import annotations

import json
import pickle
import struct
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file
from torch import Tensor

from afford.common.bounded import ZIP_ERRORS, read_member, reason
from afford.common.unpickle import Name, Opaque, RefusedError, SafeUnpickler

DTYPES = {"FloatStorage": torch.float32, "HalfStorage": torch.float16, "BFloat16Storage": torch.bfloat16,
          "DoubleStorage": torch.float64, "LongStorage": torch.int64, "IntStorage": torch.int32, "ShortStorage": torch.int16,
          "CharStorage": torch.int8, "ByteStorage": torch.uint8, "BoolStorage": torch.bool}  # fmt: skip
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "torch._utils._rebuild_tensor_v2": lambda storage, offset, size, stride, *_: torch.as_strided(storage, size, stride, offset),
    "torch._utils._rebuild_parameter": lambda data, *_: data,
    "collections.OrderedDict": lambda *_: {},
}
"""the only functions that the pickle of a checkpoint can call"""
LOCAL_HEADER = struct.Struct("<26xHH")
"""header of a zip member: lengths of the name and the extra field that follow it"""
LONGEST = 300
"""characters of a reason that an error shows"""
MAX_PICKLE_BYTES = 1 << 25
"""limit for the pickle of a checkpoint, which takes about 200 bytes for a tensor"""
MAX_NAME = 4096
"""characters of a dotted name; longer names come from mappings without end"""
TORCH_ERRORS = (*ZIP_ERRORS, SafetensorError, pickle.UnpicklingError, AttributeError, TypeError, AssertionError, MemoryError)
"""exceptions of torch.load with weights_only for a damaged file; torch documents no list"""
WHAT = "a checkpoint or TorchScript as torch 1.6 and later write them, or safetensors"


def read_tensors(path: Path) -> dict[str, Tensor]:
    """Tensors of a file by dotted name; only those below `state_dict` when the file has one. All of them are memory-mapped.

    ValueError, one sentence, when the file cannot be read or holds no tensors by name.
    """
    try:
        found = map_safetensors(path) if path.suffix == ".safetensors" else dict(named_tensors(_read_zip(path)))
    except (*ZIP_ERRORS, SafetensorError) as error:
        raise ValueError(f"{path}: expected {WHAT}; {reason(error)[:LONGEST]}") from error
    if not found:
        raise ValueError(f"{path}: expected tensors by name, got none (a frozen TorchScript has lost them); save the state_dict")
    return found


SAFE_DTYPES = {"F64": torch.float64, "F32": torch.float32, "F16": torch.float16, "BF16": torch.bfloat16, "I64": torch.int64,
               "I32": torch.int32, "I16": torch.int16, "I8": torch.int8, "U8": torch.uint8, "BOOL": torch.bool}  # fmt: skip
"""types of numbers in safetensors files"""
LENGTH = struct.Struct("<Q")
"""bytes of a safetensors file before its header: the length of the header"""


def map_safetensors(path: Path) -> dict[str, Tensor]:
    """Tensors of a safetensors file by name, memory-mapped: pages are read when they are used. A write stays in memory.

    SafetensorError or OSError for a damaged file, ValueError for numbers of a type that torch lacks on a CPU.
    """
    with safe_open(path, "pt") as checked:  # the library verifies the header: names, offsets without gaps, and the size of the file
        names = set(checked.keys())
    with path.open("rb") as file:
        (length,) = LENGTH.unpack(file.read(LENGTH.size))
        header = json.loads(file.read(length))
    start = LENGTH.size + length
    if path.stat().st_size == start:
        return {name: _mapped(np.zeros(0, np.uint8), header[name], 0) for name in sorted(names)}
    data = np.memmap(path, np.uint8, "c")
    return {name: _mapped(data, header[name], start) for name in sorted(names)}


def _mapped(data: np.ndarray, entry: dict[str, Any], start: int) -> Tensor:
    if entry["dtype"] not in SAFE_DTYPES:
        raise ValueError(f"got numbers of type {entry['dtype']}; save it with one of {', '.join(SAFE_DTYPES)}")
    first, last = entry["data_offsets"]
    part = np.array(data[start + first : start + last]) if first % 8 or start % 8 else data[start + first : start + last]
    return torch.from_numpy(part).view(SAFE_DTYPES[entry["dtype"]]).reshape(entry["shape"])


def load_weights_only(path: Path, what: str) -> dict[str, Any]:
    """Mapping of names in a safetensors file, or in a file that torch.load reads with weights_only (also from before torch 1.6).

    A zip with compressed members, which torch does not write, is refused. ValueError, one sentence, names `what` was expected.
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
    """RefusedError when a member of a zip is compressed, or a pickle has more than MAX_PICKLE_BYTES."""
    if not zipfile.is_zipfile(path):
        return
    with zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            if info.compress_type != zipfile.ZIP_STORED or info.file_size != info.compress_size:
                raise RefusedError(f"got {info.filename} compressed")
            if info.filename.endswith(".pkl") and info.file_size > MAX_PICKLE_BYTES:
                raise RefusedError(f"got {info.filename} of {info.file_size >> 20} MiB")


def named_tensors(root: Any) -> Iterator[tuple[str, Tensor]]:
    """Dotted name and tensor of every tensor in mappings and modules; of a checkpoint only those below `state_dict`."""
    root = root.get("state_dict", root) if isinstance(root, dict) else root
    seen: set[int] = set()
    waiting = [("", root)]
    while waiting:
        prefix, value = waiting.pop()
        if isinstance(value, Tensor):
            yield prefix[:-1], value
        if len(prefix) > MAX_NAME:
            raise RefusedError(f"got a name of more than {MAX_NAME} characters")
        inside = value.state if isinstance(value, Opaque) else value
        if isinstance(inside, dict) and id(inside) not in seen:
            seen.add(id(inside))
            waiting += [(f"{prefix}{key}.", item) for key, item in inside.items() if isinstance(key, str)]


def _read_zip(path: Path) -> Any:
    """Root object of the pickle in a zip."""
    with zipfile.ZipFile(path) as archive:
        found = [name for name in archive.namelist() if name.endswith("/data.pkl") and name.count("/") == 1]
        if len(found) != 1:
            raise RefusedError(f"got a zip with {len(found)} files data.pkl")
        data = read_member(archive, archive.getinfo(found[0]), found[0], MAX_PICKLE_BYTES)
        storages = _Storages(path, archive, found[0].removesuffix(".pkl"))
        return SafeUnpickler(data, FUNCTIONS, opaque=True, references=storages).load()


class _Storages:
    """Storages of a zip, each memory-mapped on request."""

    def __init__(self, path: Path, archive: zipfile.ZipFile, folder: str) -> None:
        self.path, self.archive, self.folder = path, archive, folder
        order = archive.NameToInfo.get(f"{folder.rpartition('/')[0]}/byteorder")
        if order is not None and read_member(archive, order, order.filename, len(b"little")) != b"little":
            raise RefusedError("got numbers in big-endian order")

    def __call__(self, pid: Any) -> Tensor:
        """Tensor (n,) of a persistent id ("storage", type, member, device, n)."""
        kind, type_name = pid[0], pid[1].name if isinstance(pid[1], Name) else str(pid[1])
        dtype, key = DTYPES.get(type_name.rpartition(".")[2]), f"{self.folder}/{pid[2]}"
        if kind != "storage" or dtype is None:
            raise RefusedError(f"got a {kind} of type {type_name}")
        info = self.archive.getinfo(key)
        if info.compress_type != zipfile.ZIP_STORED:
            raise RefusedError(f"got {key} compressed")
        if info.file_size == 0:
            return torch.empty(0, dtype=dtype)
        mapped = np.memmap(self.path, np.uint8, "c", self._offset(info), (info.file_size,))
        return torch.from_numpy(mapped).view(dtype)

    def _offset(self, info: zipfile.ZipInfo) -> int:
        """Position of the bytes of a member in the file."""
        with self.path.open("rb") as file:
            file.seek(info.header_offset)
            name, extra = LOCAL_HEADER.unpack(file.read(LOCAL_HEADER.size))
        return info.header_offset + LOCAL_HEADER.size + name + extra
