"""Files, columns and rows of training samples, and their division into training and validation.

A data set is one of `dataset_pack`, a released 2HANDS folder, or any folder that `datasets` wrote. Missing text is '', and a
missing taxonomy is derived from the masks. The splits are those of the data set, or separate videos or objects.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Protocol

import cv2
import numpy as np
import pyarrow as pa
from blake3 import blake3

from afford.dataset.export_2hands import first_row
from afford.dataset.load import Item
from afford.dataset.table_schema import MASKS

Files = Mapping[str, Path]
"""files of a data set: name below its folder, with forward slashes -> path"""
NEEDED = ("image", "mask_left", "mask_right", "narration")
WORDS = ("sample_id", "video", "narration", "verb", "noun", "object_left", "object_right")
NUMBERS = ("frame", "verb_class", "noun_class", "taxonomy", "quality")
SPLITS = {"train": "train", "validation": "val", "valid": "val", "val": "val", "dev": "val", "test": "test"}
NO_MOTION = np.full((4, 0, 2), np.nan, np.float32)


def files_below(folder: Path) -> Files:
    """List the files of a folder."""
    return {path.relative_to(folder).as_posix(): path for path in sorted(folder.rglob("*")) if path.is_file()}


def tables(files: Files) -> dict[str, list[str]]:
    """Split -> names of its Parquet or Arrow files; a file without a split in its name or folders belongs to `train`."""
    found: dict[str, list[str]] = {}
    for name in sorted(name for name in files if name.endswith((".parquet", ".arrow"))):
        found.setdefault(_split(PurePosixPath(name)), []).append(name)
    return found


def _split(name: PurePosixPath) -> str:
    words = re.split(r"[-_.]", name.name)[:1] + list(name.parts[:-1])
    return next((SPLITS[word] for word in words if word in SPLITS), "train")


def released(files: Files) -> dict[str, list[str]]:
    """Split -> names of its videos in the released form of 2HANDS, `<split>/h5/<start>-<end>_<video>.h5`, in order."""
    found: dict[str, list[str]] = {}
    for name in map(PurePosixPath, files):
        if name.suffix == ".h5" and name.parent.name == "h5":
            split = name.parent.parent.name
            found.setdefault(SPLITS.get(split, split), []).append(str(name))
    return {split: sorted(names, key=lambda name: first_row(PurePosixPath(name).name)) for split, names in found.items()}


def splits(files: Files) -> list[str]:
    """Names of the splits of a data set. ValueError without files of samples."""
    found = sorted(tables(files).keys() | released(files).keys())
    if not found:
        raise ValueError("data set: expected *.parquet or *.arrow files, or <split>/h5/*.h5 with <split>/jsons/*.json, found none; "
                         "give the folder that `dataset_pack` or `save_to_disk` wrote")
    return found


def wanted_columns(name: PurePosixPath, schema: pa.Schema) -> list[str]:
    """Columns of a table that a training reads. ValueError names those that are missing."""
    missing = [column for column in NEEDED if column not in schema.names]
    if missing:
        raise ValueError(f"{name}: expected the columns {', '.join(NEEDED)}, found no {', '.join(missing)}; rename the "
                         "columns of the data set")
    return [column for column in dict.fromkeys((*NEEDED, *MASKS, *WORDS, *NUMBERS)) if column in schema.names]


def item_of_row(row: dict[str, Any]) -> Item:
    """Decode a row with pictures as {bytes, path}. ValueError for a picture or mask that is damaged or of another size."""
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
    """Taxonomy class of masks (4, h, w), by the hands with a region.

    Two hands act on the same object when their objects overlap by more than half, or are not known.
    """
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
        raise ValueError(f"{name}: expected {column} to be a JPEG or PNG, got {len(data)} other bytes")
    return np.asarray(found)


GIVEN, VIDEO, OBJECT = "given", "video", "object"


@dataclass(frozen=True)
class Split:
    """Rule that splits samples into training and validation."""

    by: str = GIVEN
    """given: the splits train and val as they are; video, object: a share of the videos (nouns) of both is for validation"""
    val_fraction: float = 0.1
    """share of groups for validation, with video or object"""
    seed: int = 0

    def __post_init__(self) -> None:
        if self.by not in (GIVEN, VIDEO, OBJECT):
            raise ValueError(f"split_by: expected given, video or object, got {self.by!r}")
        if not 0 < self.val_fraction < 1:
            raise ValueError(f"val_fraction: expected more than 0 and less than 1, got {self.val_fraction}")


class Grouped(Protocol):
    """Labels that a division needs of a sample."""

    @property
    def sample_id(self) -> str:
        """Name of the sample."""

    @property
    def video(self) -> str:
        """Its video."""

    @property
    def noun(self) -> str:
        """Its object."""


def group_of(item: Grouped, by: str) -> str:
    """Group of a sample, which is in one split only: its video or noun. ValueError when the data set lacks it."""
    label = item.video if by == VIDEO else item.noun
    if not label:
        raise ValueError(f"{item.sample_id}: expected a {'video' if by == VIDEO else 'noun'} to split by, found none; "
                         "choose another split_by")
    return label


def is_validation(label: str, division: Split) -> bool:
    """Decide whether a group is for validation, by the seeded hash of its name alone."""
    digest = blake3(f"{division.seed}:{label}".encode()).digest(7)
    return int.from_bytes(digest, "big") / 2.0**56 < division.val_fraction
