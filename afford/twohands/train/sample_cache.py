"""Cache of decoded samples on disk, read through memory maps: JPEG and PNG are decoded once, not once per epoch.

pixels.bin contains the images one after the other, (h, w, 3) uint8, and masks.bin their four masks, a bit per pixel. index.json is
written last and contains offsets, sizes and labels.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from blake3 import blake3

from afford.dataset.load import Item
from afford.twohands.train.samples import NO_MOTION, NUMBERS, WORDS

PIXELS, PACKED, INDEX = "pixels.bin", "masks.bin", "index.json"


def write_cache(items: Iterable[Item], folder: Path, largest_px: tuple[int, int]) -> None:
    """Decode all samples into a cache. Images larger than `largest_px` (height, width) are shrunk, with their aspect ratio.

    A complete and undamaged cache is kept, so that a resumed training does not decode again.
    """
    if _is_whole(folder):
        return
    folder.mkdir(parents=True, exist_ok=True)
    index = []
    with (folder / PIXELS).open("wb") as pixels, (folder / PACKED).open("wb") as packed:
        for item in items:
            small = shrink(item, largest_px)
            words = {name: getattr(small, name) for name in (*WORDS, *NUMBERS)}
            index.append({"at": [pixels.tell(), packed.tell()], "size": small.image.shape[:2], **words})
            pixels.write(small.image.tobytes())
            packed.write(np.packbits(small.masks).tobytes())
    partial, rows = folder / f"{INDEX}.partial", json.dumps(index)
    partial.write_text(json.dumps({"check": _checksum(folder, rows), "rows": rows}))
    os.replace(partial, folder / INDEX)


def _is_whole(folder: Path) -> bool:
    """Check that the folder has a cache whose bytes match the checksum."""
    try:
        index = json.loads((folder / INDEX).read_text())
        return bool(index["check"] == _checksum(folder, index["rows"]))
    except (FileNotFoundError, ValueError, KeyError, TypeError):
        return False


def _checksum(folder: Path, rows: str) -> str:
    digest = blake3(rows.encode())
    for name in (PIXELS, PACKED):
        digest.update_mmap(folder / name)
    return digest.hexdigest()


def shrink(item: Item, largest_px: tuple[int, int]) -> Item:
    """Shrink a sample to fit `largest_px`."""
    height, width = item.image.shape[:2]
    scale = min(1.0, largest_px[0] / height, largest_px[1] / width)
    if scale == 1.0:
        return item
    size = max(1, round(width * scale)), max(1, round(height * scale))
    masks = np.stack([_shrink_mask(plane, size) for plane in item.masks])
    return replace(item, image=cv2.resize(item.image, size, interpolation=cv2.INTER_AREA), masks=masks)


def _shrink_mask(plane: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Mask (h, w) bool at a smaller size (width, height): pixels that it covers by half."""
    if not plane.any():
        return np.zeros(size[::-1], bool)
    return np.asarray(cv2.resize(plane.view(np.uint8) * np.uint8(255), size, interpolation=cv2.INTER_AREA) > 127)


class SampleCache(Sequence[Item]):
    """Samples of a cache; safe to read from several threads."""

    def __init__(self, folder: Path) -> None:
        self.rows: list[dict[str, Any]] = json.loads(json.loads((folder / INDEX).read_text())["rows"])
        self._pixels, self._packed = (_map(folder / name) for name in (PIXELS, PACKED))

    def __len__(self) -> int:
        return len(self.rows)

    def column(self, name: str) -> list[Any]:
        """Label of every sample."""
        return [row[name] for row in self.rows]

    def __getitem__(self, index: Any) -> Any:
        row = self.rows[index]
        (pixel, bit), (height, width) = row["at"], row["size"]
        count = height * width
        image = self._pixels[pixel : pixel + 3 * count].reshape(height, width, 3)
        bits = np.unpackbits(self._packed[bit : bit + (4 * count + 7) // 8], count=4 * count)
        words = {name: row[name] for name in (*WORDS, *NUMBERS)}
        return Item(image=image, masks=bits.view(bool).reshape(4, height, width), motion=NO_MOTION,
                    motion_time_ns=np.zeros(0, np.int64), **words)


def _map(path: Path) -> np.ndarray:
    return np.memmap(path, np.uint8, "r") if path.stat().st_size else np.zeros(0, np.uint8)
