"""Samples read from their files when they are needed, in any order; no decoded copy is written.

An index of labels is made first. The pictures of a row group are looked up when one of them is first needed: where the file has
them uncompressed, as those of `dataset_pack`, a sample then costs its own bytes alone, through a memory map; elsewhere its row
group is read. Encoded row groups and decoded samples are kept in memory up to fixed limits, so that a small data set is decoded
once. Samples of Arrow streams and of released h5 files are read one by one (single_samples.py).
"""

from __future__ import annotations

import json
import mmap
import os
from collections import OrderedDict
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from threading import Lock
from typing import Any, Generic, NamedTuple, TypeVar

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.ipc as ipc
import pyarrow.parquet as pq
from blake3 import blake3

from afford.dataset.load import Item
from afford.dataset.parquet_shards import damage_as_error, open_shard
from afford.dataset.table_schema import MASKS
from afford.twohands.train import single_samples
from afford.twohands.train.samples import (
    GIVEN,
    NO_MOTION,
    NUMBERS,
    WORDS,
    Files,
    Split,
    group_of,
    is_validation,
    item_of_row,
    released,
    splits,
    tables,
    wanted_columns,
)
from afford.twohands.train.single_samples import Shard

LABELS, SHARDS, PARQUET = "labels.arrow", "shards.json", ".parquet"
ENCODED_BYTES, DECODED_BYTES = 256 << 20, 512 << 20
"""limits of the row groups that are kept in memory, and of the decoded images as of the decoded masks"""
PICTURE = "image.bytes"
"""Parquet's name of the column of encoded pictures"""
PREFIX, KEY = 4, 32
"""bytes of the length before a value in a Parquet page; bytes by which a value is looked for"""
Labels = tuple[str, ...]
LABEL_COLUMNS: Labels = ("video", "narration", "verb", "noun", "taxonomy")
"""labels that a training needs of all samples"""
V = TypeVar("V")


class Bounded(Generic[V]):
    """Values by key, of which the least recently used ones are dropped beyond `limit` bytes. Safe in several threads."""

    def __init__(self, limit: int) -> None:
        self.limit, self.used = limit, 0
        self._kept: OrderedDict[Hashable, tuple[V, int]] = OrderedDict()
        self._lock = Lock()

    def get(self, key: Hashable) -> V | None:
        """Value of a key, None when it is not there."""
        with self._lock:
            if key not in self._kept:
                return None
            self._kept.move_to_end(key)
            return self._kept[key][0]

    def put(self, key: Hashable, value: V, size: int) -> None:
        """Keep a value of `size` bytes."""
        with self._lock:
            self.used -= self._kept.pop(key, (None, 0))[1]
            self._kept[key] = value, size
            self.used += size
            while self.used > self.limit:
                self.used -= self._kept.popitem(last=False)[1][1]


def write_samples(data: Files, division: Split, name: str, folder: Path, largest_px: tuple[int, int]) -> None:
    """Prepare the part `name` (train, val) of a data set for `SampleStream`.

    Pictures larger than `largest_px` (height, width) are shrunk when they are read. ValueError for a part without samples of its
    own, or for a table without the needed columns.
    """
    if (folder / SHARDS).is_file():
        return
    folder.mkdir(parents=True, exist_ok=True)
    files, videos = tables(data), released(data)
    shards = [shard for split in _splits(data, division, name) for shard in (*videos.get(split, ()), *files.get(split, ()))]
    chosen = pa.concat_tables([_labels(data, shard, n, division, name) for n, shard in enumerate(shards)] or [_no_labels()])
    with pa.OSFile(str(folder / LABELS), "wb") as sink, ipc.new_file(sink, chosen.schema) as writer:
        writer.write_table(chosen)
    used = [one for shard in shards for one in (shard, single_samples.outlines_of(shard)) if one in data]
    listed = {"largest_px": list(largest_px), "shards": shards, "files": {name: str(data[name].absolute()) for name in used}}
    (folder / f"{SHARDS}.partial").write_text(json.dumps(listed))
    os.replace(folder / f"{SHARDS}.partial", folder / SHARDS)


def _splits(data: Files, division: Split, name: str) -> list[str]:
    found = splits(data)
    if division.by != GIVEN:
        return [split for split in found if split != "test"]
    if name not in found:
        raise ValueError(f"data set: expected a split {name}, found {', '.join(found)}; set split_by=video to split it here")
    return [name]


class Labelled(NamedTuple):
    """Labels by which a sample is divided (`samples.group_of`)."""

    sample_id: str
    video: str
    noun: str


def _no_labels() -> pa.Table:
    kinds = {name: pa.int64() if name == "taxonomy" else pa.string() for name in LABEL_COLUMNS}
    return pa.table({name: pa.array([], kinds.get(name, pa.int64())) for name in ("shard", "group", "row", *LABEL_COLUMNS)})


def _labels(data: Files, shard: str, number: int, division: Split, part: str) -> pa.Table:
    """Labels of the samples of a shard that belong to a part, with their places."""
    rows: dict[str, list[Any]] = {name: [] for name in _no_labels().column_names}
    for group, row, found in _parquet_labels(data, shard) if shard.endswith(PARQUET) else _single_labels(data, shard):
        words = {name: found.get(name) or "" for name in ("video", "narration", "verb", "noun")}
        label = Labelled(str(found.get("sample_id") or words["narration"]), words["video"], words["noun"])
        if division.by != GIVEN and is_validation(group_of(label, division.by), division) != (part == "val"):
            continue
        for name, value in {"shard": number, "group": group, "row": row, "taxonomy": found["taxonomy"], **words}.items():
            rows[name].append(value)
    return pa.table(rows, schema=_no_labels().schema)


def _single_labels(data: Files, shard: str) -> Iterator[tuple[int, int, dict[str, Any]]]:
    yield from ((0, row, labels) for row, labels in enumerate(single_samples.open_shard(data, shard).labels()))


def _parquet_labels(data: Files, shard: str) -> Iterator[tuple[int, int, dict[str, Any]]]:
    """Yield row group, row and labels of the samples of a shard."""
    with open_shard(data[shard], shard) as file, damage_as_error(data[shard], shard):
        there = wanted_columns(PurePosixPath(shard), file.schema_arrow)
        plain = [name for name in ("sample_id", *LABEL_COLUMNS) if name in there]
        for group in range(file.num_row_groups):
            known = "taxonomy" in there and not _has_nulls(file, group, "taxonomy")
            table = file.read_row_group(group, columns=plain if known else there, use_threads=False)
            for row, labels in enumerate(table.to_pylist()):
                yield group, row, labels if known else {**labels, "taxonomy": item_of_row(labels).taxonomy}


def _has_nulls(file: pq.ParquetFile, group: int, column: str) -> bool:
    chunk = _chunk(file, group, column)
    statistics = None if chunk is None else chunk.statistics
    return statistics is None or not statistics.has_null_count or statistics.null_count > 0


def _chunk(file: pq.ParquetFile, group: int, column: str) -> Any:
    found = file.metadata.row_group(group)
    chunks = (found.column(n) for n in range(found.num_columns))
    return next((chunk for chunk in chunks if chunk.path_in_schema == column), None)


class _Group(NamedTuple):
    """Encoded row group: rows without pictures, and the place of each picture in the file, or the pictures."""

    rows: list[dict[str, Any]]
    places: list[tuple[int, int]] | None
    pictures: list[dict[str, Any]]


class _Packed(NamedTuple):
    """Decoded sample but for its image, which is kept once for all samples that show it."""

    image: bytes
    """digest of the pixels"""
    bits: np.ndarray
    words: Mapping[str, Any]


class SampleStream(Sequence[Item]):
    """Samples of a part that `write_samples` prepared; safe to read from several threads."""

    def __init__(self, folder: Path, encoded_bytes: int = ENCODED_BYTES, decoded_bytes: int = DECODED_BYTES) -> None:
        """Open the index; the shards are opened when they are needed."""
        listed = json.loads((folder / SHARDS).read_text())
        self._files = {name: Path(path) for name, path in listed["files"].items()}
        self._shards = [(name, self._files[name]) for name in listed["shards"]]
        self._largest = listed["largest_px"][0], listed["largest_px"][1]
        with pa.memory_map(str(folder / LABELS)) as source:
            self._table = ipc.open_file(source).read_all()
        self._place = np.stack([self._table[name].to_numpy() for name in ("shard", "group", "row")], 1)
        self._groups: Bounded[_Group] = Bounded(encoded_bytes)
        self._single: Bounded[Shard] = Bounded(encoded_bytes)
        self._decoded: Bounded[_Packed] = Bounded(decoded_bytes)
        self._images: Bounded[np.ndarray] = Bounded(decoded_bytes)
        self._maps: dict[int, mmap.mmap] = {}

    def __len__(self) -> int:
        return len(self._place)

    def column(self, name: str) -> list[Any]:
        """Label of every sample, one of LABEL_COLUMNS."""
        found: list[Any] = self._table[name].to_pylist()
        return found

    def __getitem__(self, index: Any) -> Any:
        at = range(len(self))[index]
        kept = self._decoded.get(at)
        image = None if kept is None else self._images.get(kept.image)
        if kept is None or image is None:
            return self._decode(at)
        height, width = image.shape[:2]
        masks = np.unpackbits(kept.bits, count=4 * height * width).view(bool).reshape(4, height, width)
        return Item(image=image, masks=masks, motion=NO_MOTION, motion_time_ns=np.zeros(0, np.int64), **kept.words)

    def _decode(self, at: int) -> Item:
        """Decode a sample, and keep it."""
        shard, group, row = (int(one) for one in self._place[at])
        whole = self._of_group(shard, group, row) if self._shards[shard][0].endswith(PARQUET) else self._shard(shard).item(row)
        item = shrink(whole, self._largest)
        digest = blake3(item.image.tobytes()).digest()
        kept = _Packed(digest, np.packbits(item.masks), {name: getattr(item, name) for name in (*WORDS, *NUMBERS)})
        self._decoded.put(at, kept, kept.bits.nbytes)
        if self._images.get(digest) is None:
            self._images.put(digest, item.image, item.image.nbytes)
        return replace(item, motion=NO_MOTION, motion_time_ns=np.zeros(0, np.int64))

    def _shard(self, shard: int) -> Shard:
        kept = self._single.get(shard)
        if kept is None:
            kept = single_samples.open_shard(self._files, self._shards[shard][0])
            self._single.put(shard, kept, kept.nbytes)
        return kept

    def _of_group(self, shard: int, group: int, row: int) -> Item:
        found = self._group(shard, group)
        if found.places is None:
            picture = found.pictures[row]
        else:
            first, last = found.places[row]
            picture = {"bytes": self._map(shard)[first:last]}
        return item_of_row({**found.rows[row], "image": picture})

    def _group(self, shard: int, group: int) -> _Group:
        kept = self._groups.get((shard, group))
        if kept is not None:
            return kept
        name, path = self._shards[shard]
        with open_shard(path, name) as file, damage_as_error(path, name):
            table = file.read_row_group(group, columns=wanted_columns(PurePosixPath(name), file.schema_arrow), use_threads=False)
            rows = table.drop_columns(["image"]).to_pylist()
            pictures = table["image"].to_pylist()
            places = self._places(shard, _chunk(file, group, PICTURE), pictures)
        made = _Group(rows, places, [] if places else pictures)
        size = sum(len((row.get(name) or {}).get("bytes") or b"") for row in rows for name in MASKS) + 500 * len(rows)
        self._groups.put((shard, group), made, size + sum(len(one["bytes"] or b"") for one in made.pictures))
        return made

    def _places(self, shard: int, chunk: Any, pictures: list[dict[str, Any]]) -> list[tuple[int, int]] | None:
        """First and last byte of every picture in the file; None where it has them compressed, or in another encoding."""
        if chunk is None or chunk.compression != "UNCOMPRESSED" or chunk.has_dictionary_page:
            return None
        data, at, found = self._map(shard), chunk.data_page_offset, []
        end = at + chunk.total_compressed_size
        for picture in pictures:
            value = picture["bytes"] or b""
            at = data.find(value[:KEY], at, end) if value else -1
            if at < 0 or data[at - PREFIX : at] != len(value).to_bytes(PREFIX, "little") or data[at : at + len(value)] != value:
                return None
            found.append((at, at + len(value)))
            at += len(value)
        return found

    def _map(self, shard: int) -> mmap.mmap:
        if shard not in self._maps:
            with self._shards[shard][1].open("rb") as file:
                self._maps[shard] = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        return self._maps[shard]


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


def label_rows(samples: SampleStream, *names: str) -> Iterator[tuple[Any, ...]]:
    """Yield the labels of every sample."""
    yield from zip(*(samples.column(name) for name in names), strict=True)
