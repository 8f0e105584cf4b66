"""Reader of a packed data set: samples as arrays, and batches of a `torch.utils.data.DataLoader` with `collate`."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from itertools import accumulate
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa

from afford.common.bounded import check_image
from afford.dataset import masks
from afford.dataset.parquet_shards import damage_as_error, open_shard, read_group
from afford.dataset.table_schema import MASKS, PATHS

WORDS = ("sample_id", "video", "narration", "verb", "noun", "object_left", "object_right")
NUMBERS = ("frame", "verb_class", "noun_class", "taxonomy", "quality")
NEEDED = (*WORDS, *NUMBERS, "image", "motion", "motion_time_ns", *MASKS)


@dataclass(frozen=True)
class Item(Mapping[str, Any]):
    """Decoded sample, also a mapping of its fields, as torch's default collate function requires."""

    sample_id: str
    video: str
    frame: int
    image: np.ndarray
    """(h, w, 3) uint8 RGB, hands removed"""
    masks: np.ndarray
    """(4, h, w) bool: affordance left, right; complete object left, right"""
    narration: str
    verb: str
    noun: str
    verb_class: int
    noun_class: int
    object_left: str
    object_right: str
    taxonomy: int
    """0 left, 1 right, 2 both on one object, 3 both on different objects"""
    quality: float
    motion: np.ndarray
    """(4, s, 2) float32 px: left hand, right hand, left object, right object; NaN out of sight"""
    motion_time_ns: np.ndarray
    """(s,) int64, time after the sample in ns"""

    def __getitem__(self, name: str) -> Any:
        """Return the field of this name; KeyError for an unknown name."""
        if name not in self.__dataclass_fields__:
            raise KeyError(name)
        return getattr(self, name)

    def __iter__(self) -> Iterator[str]:
        return iter(self.__dataclass_fields__)

    def __len__(self) -> int:
        return len(self.__dataclass_fields__)


def collate(items: Sequence[Item]) -> dict[str, Any]:
    """Collate samples for `DataLoader(Dataset(folder), collate_fn=collate)`.

    Returns a tensor (b, ...) for each array or number of Item, and a list for each string. Raises ValueError where arrays
    differ in shape.
    """
    import torch

    batch: dict[str, Any] = {}
    for name, values in ((field.name, [getattr(item, field.name) for item in items]) for field in fields(Item)):
        shapes = sorted({np.shape(value) for value in values})
        if len(shapes) > 1:
            raise ValueError(f"field {name!r}: expected one shape in a batch, got {shapes[0]} and {shapes[1]}; bring the samples "
                             "to one size before, or take batches of one")
        batch[name] = values if isinstance(values[0], str) else torch.from_numpy(np.stack(values))
    return batch


def splits(root: Path | str) -> list[str]:
    """Return the names of the splits: train, val, test, then others. Raises ValueError when there is none."""
    root = Path(root)
    names = {path.name.rsplit("-", 3)[0] for path in (root / "data").glob("*-of-*.parquet")}
    if not names:
        raise ValueError(f"{root.name}/data: expected <split>-NNNNN-of-NNNNN.parquet, found none; "
                         "give the folder of a data set that `dataset_pack` wrote")
    return [name for name in ("train", "val", "test") if name in names] + sorted(names - {"train", "val", "test"})


def shards(root: Path | str, split: str) -> list[Path]:
    """Return the Parquet files of one split. Raises ValueError when there is none."""
    root = Path(root)
    if split not in splits(root):
        raise ValueError(f"{root.name}/data: expected {split}-*.parquet, found the splits {', '.join(splits(root))}")
    return sorted((root / "data").glob(f"{split}-*-of-*.parquet"))


def rows(root: Path, split: str, columns: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield the stored rows of a split in order (images as bytes), one row group in memory at a time.

    Raises SourceError for a damaged row group.
    """
    for path in shards(root, split):
        for group in range(_groups(path)):
            with damage_as_error(path):
                found = read_group(path, group, columns).to_pylist()
            yield from found


def _groups(path: Path) -> int:
    with open_shard(path) as file:
        return int(file.num_row_groups)


class Dataset(Sequence[Item]):
    """One split of a data set as a sequence of samples.

    Indexing decodes one sample; iterating reads the shards in order. Raises SourceError when a shard is damaged.
    """

    def __init__(self, root: Path | str, split: str = "train") -> None:
        self.files = shards(root, split)
        lengths = [_lengths(path) for path in self.files]
        self.groups = [(n, group) for n, rows in enumerate(lengths) for group in range(len(rows))]
        self.ends = list(accumulate(length for rows in lengths for length in rows))
        with open_shard(self.files[0]) as file, damage_as_error(self.files[0]):
            self.features = json.loads(file.schema_arrow.metadata[b"huggingface"])["info"]["features"]
        self._group = lru_cache(maxsize=4)(self._read)

    def __len__(self) -> int:
        return self.ends[-1] if self.ends else 0

    def __getitem__(self, index: Any) -> Any:
        """Return sample `index`; negative indices count from the end."""
        at = index + len(self) if index < 0 else index
        if not 0 <= at < len(self):
            raise IndexError(f"sample {index}: the split has {len(self)}")
        group = bisect_right(self.ends, at)
        return self._group(group).item(at - (self.ends[group - 1] if group else 0))

    def __iter__(self) -> Iterator[Item]:
        for group in range(len(self.groups)):
            read = self._read(group)
            yield from (read.item(n) for n in range(read.size))

    def __getstate__(self) -> dict[str, Any]:
        return {name: found for name, found in self.__dict__.items() if name != "_group"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._group = lru_cache(maxsize=4)(self._read)

    def class_names(self, column: str) -> list[str]:
        """Return the names of the labels of `verb_class`, `noun_class`, `taxonomy` or `taxonomy3`."""
        return self.features[column]["names"]

    def _read(self, group: int) -> _Group:
        number, inside = self.groups[group]
        path = self.files[number]
        with damage_as_error(path):
            return _Group(path, read_group(path, inside, NEEDED).combine_chunks())


def _lengths(path: Path) -> list[int]:
    """Return the number of rows of each row group of a shard."""
    with open_shard(path) as file:
        return [file.metadata.row_group(group).num_rows for group in range(file.num_row_groups)]


class _Group:
    """Row group with its columns unpacked; images are decoded on access."""

    def __init__(self, path: Path, table: pa.Table) -> None:
        self.path = path
        self.size = table.num_rows
        self.plain = {name: table[name].to_pylist() for name in (*WORDS, *NUMBERS)}
        self.jpeg = table["image"].chunk(0).field("bytes")
        self.png = [table[name].chunk(0).field("bytes") for name in MASKS]
        self.times = np.array(_block(table["motion_time_ns"].chunk(0), self.size))  # a writable copy, as torch requires
        motion = table["motion"].chunk(0)
        self.motion = np.stack([_block(motion.field(name), self.size, 2) for name in PATHS], axis=1)

    def item(self, n: int) -> Item:
        """Decode sample `n`. Raises SourceError when one of its images is damaged."""
        with damage_as_error(self.path):
            return self._item(n)

    def _item(self, n: int) -> Item:
        data = self.jpeg[n].as_py()
        check_image(data, f"{self.plain['sample_id'][n]}, column `image`")
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
        planes = np.stack([masks.decode_png(png[n].as_py()) for png in self.png])
        if image is None or planes.shape[1:] != image.shape[:2]:
            raise ValueError(f"{self.plain['sample_id'][n]}: column `image` is not a JPEG of the size of its masks")
        return Item(image=image, masks=planes, motion=self.motion[n], motion_time_ns=self.times[n],
                    **{name: found[n] for name, found in self.plain.items()})


def _block(lists: Any, size: int, *last: int) -> np.ndarray:
    """Convert nested lists of equal length to an array (size, s, *last)."""
    while pa.types.is_list(lists.type):
        lists = lists.flatten()
    return lists.to_numpy(zero_copy_only=False).reshape(size, -1, *last)
