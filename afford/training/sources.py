"""Where samples come from: a data set of `dataset_pack`, a released 2HANDS folder, or any folder that `datasets` has written.

Every form is read into the same `Item`. What a folder does not say is '', and the taxonomy follows from the masks.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from afford.dataset import export_2hands
from afford.dataset.columns import MASKS
from afford.dataset.load import Item

NEEDED = ("image", "mask_left", "mask_right", "narration")
WORDS = ("sample_id", "video", "narration", "verb", "noun", "object_left", "object_right")
NUMBERS = ("frame", "verb_class", "noun_class", "taxonomy", "quality")
SPLITS = {"train": "train", "validation": "val", "valid": "val", "val": "val", "dev": "val", "test": "test"}
NO_MOTION = np.full((4, 0, 2), np.nan, np.float32)


def tables(folder: Path) -> dict[str, list[Path]]:
    """Split -> its Parquet or Arrow files, by name. A file whose name and folder say no split belongs to `train`."""
    found: dict[str, list[Path]] = {}
    for path in sorted(path for kind in ("*.parquet", "*.arrow") for path in folder.rglob(kind)):
        found.setdefault(_split(path.relative_to(folder)), []).append(path)
    return found


def _split(path: Path) -> str:
    words = re.split(r"[-_.]", path.name)[:1] + list(path.parts[:-1])
    return next((SPLITS[word] for word in words if word in SPLITS), "train")


def released(folder: Path) -> dict[str, Path]:
    """Split -> its folder in the released form of 2HANDS."""
    return {SPLITS.get(path.parent.name, path.parent.name): path.parent for path in sorted(folder.rglob("h5")) if path.is_dir()}


def splits(folder: Path) -> list[str]:
    """The splits of a folder. ValueError when there is nothing to read."""
    found = sorted(tables(folder).keys() | released(folder).keys())
    if not found:
        raise ValueError("data set: expected *.parquet or *.arrow files, or <split>/h5/*.h5 with <split>/jsons/*.json, found none; "
                         "give the folder that `dataset_pack` or `save_to_disk` wrote")
    return found


def items(folder: Path, split: str) -> Iterator[Item]:
    """All samples of one split, in the order of the files."""
    if split in released(folder):
        for n, row in enumerate(export_2hands.read(released(folder)[split])):
            yield _of_released(row, n)
    for path in tables(folder).get(split, ()):
        for batch in _batches(path):
            yield from map(item, batch.to_pylist())


def _batches(path: Path) -> Iterable[pa.RecordBatch]:
    """The columns that are wanted, some rows at a time. ValueError names those that are missing."""
    if path.suffix == ".parquet":
        with pq.ParquetFile(path) as file:
            yield from file.iter_batches(64, columns=_wanted(path, file.schema_arrow), use_threads=False)
        return
    with pa.memory_map(str(path)) as source, pa.ipc.open_stream(source) as stream:
        wanted = _wanted(path, stream.schema)
        yield from (batch.select(wanted) for batch in stream)


def _wanted(path: Path, schema: pa.Schema) -> list[str]:
    missing = [name for name in NEEDED if name not in schema.names]
    if missing:
        raise ValueError(f"{path.name}: expected the columns {', '.join(NEEDED)}, found no {', '.join(missing)}; rename the "
                         "columns of the data set")
    return [name for name in dict.fromkeys((*NEEDED, *MASKS, *WORDS, *NUMBERS)) if name in schema.names]


def item(row: dict[str, Any]) -> Item:
    """One row, its pictures as {bytes, path}. ValueError when a picture or a mask cannot be read, or does not fit."""
    name = str(row.get("sample_id") or row["narration"])
    image = _decode(row["image"], name, "image", cv2.IMREAD_COLOR_RGB)
    planes = [_decode(row[column], name, column, cv2.IMREAD_GRAYSCALE) > 0 if row.get(column) else np.zeros(image.shape[:2], bool)
              for column in MASKS]
    for column, plane in zip(MASKS, planes, strict=True):
        if plane.shape != image.shape[:2]:
            raise ValueError(f"{name}: expected {column} of the image's size {image.shape[:2]}, got {plane.shape}")
    masks = np.stack(planes)
    given = {key: row[key] for key in (*WORDS, *NUMBERS) if row.get(key) is not None}
    words = {key: given.get(key, "") for key in WORDS} | {"sample_id": name}
    numbers = {"frame": 0, "verb_class": -1, "noun_class": -1, "quality": 1.0, "taxonomy": taxonomy_of(masks)}
    return Item(image=image, masks=masks, motion=NO_MOTION, motion_time_ns=np.zeros(0, np.int64),
                **words, **numbers | {key: given[key] for key in NUMBERS if key in given})  # type: ignore[arg-type]  # by name


def taxonomy_of(masks: np.ndarray) -> int:
    """Taxonomy, 4-way, of (4, h, w) masks: which hands there are; both on the same object when the objects overlap by half, or
    are not known."""
    left, right = masks[0].any(), masks[1].any()
    if not (left and right):
        return 1 if right else 0
    union = np.count_nonzero(masks[2] | masks[3])
    return 2 if not union or np.count_nonzero(masks[2] & masks[3]) > union / 2 else 3


def _decode(picture: Any, name: str, column: str, kind: int) -> np.ndarray:
    data = picture.get("bytes") if isinstance(picture, dict) else None
    if not data:
        raise ValueError(f"{name}: expected {column} with the bytes of a picture, got {type(picture).__name__} without; save the "
                         "data set with its pictures inside")
    found = cv2.imdecode(np.frombuffer(data, np.uint8), kind)
    if found is None:
        raise ValueError(f"{name}: expected {column} to be a JPEG or PNG, got {len(data)} bytes that are none")
    return np.asarray(found)


def _of_released(row: dict[str, Any], n: int) -> Item:
    return Item(sample_id=f"{n:06d}", video="", frame=n, image=np.ascontiguousarray(row["image"]), masks=row["masks"],
                narration=row["narration"], verb=row["verb"], noun=row["noun"], verb_class=-1, noun_class=-1,
                object_left=row["obj_id_left"], object_right=row["obj_id_right"], taxonomy=int(np.argmax(row["taxonomy"])),
                quality=1.0, motion=NO_MOTION, motion_time_ns=np.zeros(0, np.int64))
