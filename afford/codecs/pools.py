"""Array storage, pooled so that a clip with a thousand polygons is still three files.

The tree of a value contains a reference for each array: ``{"raw": [dtype, offset, shape]}`` into one flat array per dtype
(arrays.safetensors), ``{"rle": [offset, shape]}`` into a list of COCO run lengths (masks.json.zst), ``{"zstd": [file, dtype,
shape]}`` or ``{"video": [file, shape]}`` for a file of its own.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pycocotools import mask as coco
from safetensors.numpy import load_file, save_file
from zstandard import ZstdCompressor, ZstdDecompressor

from afford.common.registry import load

ENCODERS = {"video": "afford.codecs.video:write_video"}
DECODERS = {"video": "afford.codecs.video:read_video"}
"""encoding of a field -> function that stores an array in a file; stages without such a field do not depend on that code"""
ARRAYS, MASKS = "arrays.safetensors", "masks.json.zst"
LEVEL = 3


class Writer:
    """Writer of the arrays of one value."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._raw: dict[str, list[np.ndarray]] = {}
        self._length: dict[str, int] = {}
        self._counts: list[str] = []

    def put(self, name: str, value: np.ndarray, encoding: str) -> dict[str, list[Any]]:
        """Store one array under a file name that is unique in the value; return its reference."""
        shape = list(value.shape)
        if not value.size or encoding == "raw":
            return {"raw": [value.dtype.name, self._flat(value), shape]}
        if encoding == "rle":
            return {"rle": [self._masks(value), shape]}
        if encoding == "zstd":
            data = ZstdCompressor(level=LEVEL).compress(np.ascontiguousarray(value).tobytes())
            (self._folder / f"{name}.zst").write_bytes(data)
            return {"zstd": [f"{name}.zst", value.dtype.name, shape]}
        load(ENCODERS, encoding)(self._folder / f"{name}.mkv", value)
        return {"video": [f"{name}.mkv", shape]}

    def close(self) -> None:
        """Write the pools."""
        if self._raw:
            save_file({name: np.concatenate(parts) for name, parts in sorted(self._raw.items())}, self._folder / ARRAYS)
        if self._counts:
            data = json.dumps(self._counts, separators=(",", ":")).encode()
            (self._folder / MASKS).write_bytes(ZstdCompressor(level=LEVEL).compress(data))

    def _flat(self, value: np.ndarray) -> int:
        name = value.dtype.name
        offset = self._length.get(name, 0)
        self._raw.setdefault(name, []).append(np.ascontiguousarray(value).reshape(-1))
        self._length[name] = offset + value.size
        return offset

    def _masks(self, value: np.ndarray) -> int:
        offset = len(self._counts)
        height, width = value.shape[-2:]
        for mask in value.reshape(-1, height, width):
            self._counts.append(coco.encode(np.asfortranarray(mask.view(np.uint8)))["counts"].decode("ascii"))
        return offset


class Reader:
    """Reader of the arrays of one value. Pools are read on first use, and returned arrays are read-only."""

    def __init__(self, files: Mapping[str, Path]) -> None:
        self._files = files

    @cached_property
    def _raw(self) -> dict[str, np.ndarray]:
        return load_file(self._files[ARRAYS])

    @cached_property
    def _counts(self) -> list[str]:
        counts: list[str] = json.loads(ZstdDecompressor().decompress(self._files[MASKS].read_bytes()))
        return counts

    def get(self, reference: Mapping[str, Any]) -> np.ndarray:
        """Return the array of a reference."""
        ((encoding, where),) = reference.items()
        ways: dict[str, Callable[..., np.ndarray]] = {
            "raw": self._flat, "rle": self._masks, "zstd": self._zstd, "video": self._video,
        }  # fmt: skip
        value = ways[encoding](*where)
        value.setflags(write=False)
        return value

    def _flat(self, dtype: str, offset: int, shape: list[int]) -> np.ndarray:
        return self._raw[dtype][offset : offset + int(np.prod(shape))].reshape(shape)

    def _masks(self, offset: int, shape: list[int]) -> np.ndarray:
        count, size = int(np.prod(shape[:-2])), shape[-2:]
        out = np.zeros((count, *size), bool)
        for i, counts in enumerate(self._counts[offset : offset + count]):
            out[i] = coco.decode({"size": size, "counts": counts.encode("ascii")})
        return out.reshape(shape)

    def _zstd(self, file: str, dtype: str, shape: list[int]) -> np.ndarray:
        data = ZstdDecompressor().decompress(self._files[file].read_bytes())
        return np.frombuffer(data, dtype).reshape(shape)

    def _video(self, file: str, shape: list[int]) -> np.ndarray:
        value: np.ndarray = load(DECODERS, "video")(self._files[file], tuple(shape))
        return value
