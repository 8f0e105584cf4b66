"""Example pictures of the demo that the model was not trained on.

They are those that are shipped with a model, stills of a benchmark set, or pictures of the validation split of the data set of the
training, where the store has them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet as pq

from afford.common.errors import SourceError
from afford.common.image_files import decode_image, jpeg, read_image
from afford.dataset.act_affordance import ANNOTATION, IMAGE
from afford.training.artifacts import CARD
from afford.twohands.train.samples import tables

EXAMPLES = "examples"
COUNT, MANY = 6, 1000
DIGEST = re.compile(r"content digest `([0-9a-f]{64})`")
"""form in which the card of a model names its data set"""
COLUMNS = ("video", "narration", "image")
MIN_SIDE_PX, MAX_SIDE_PX = 160, 640


@dataclass(frozen=True)
class Example:
    """Example picture and a task for it."""

    task: str
    jpeg: bytes


def examples(benchmarks: Path, sets: str = "*") -> list[Example]:
    """Choose up to COUNT stills of the rendered sets below `benchmarks`, from different rooms where possible."""
    rooms = [sorted(room.glob(f"*/{IMAGE}")) for room in sorted(benchmarks.glob(f"{sets}/masks/[!.]*"))]
    return _chosen(_still(path) for path in _in_turns(rooms))


def beside(model: Path) -> list[Example]:
    """Read the pictures `examples/*.jpg` in the folder of a model; their names are the tasks, with `-` for spaces."""
    return [Example(path.stem.replace("-", " "), path.read_bytes()) for path in sorted((model / EXAMPLES).glob("*.jpg"))]


def data_set(model: Path) -> str | None:
    """Content digest of the data set of a model's training, read from its card; None without a card."""
    card = model.parent / CARD
    found = DIGEST.search(card.read_text(encoding="utf-8")) if card.is_file() else None
    return found[1] if found else None


def held_out(files: Mapping[str, Path]) -> list[Example]:
    """Choose up to COUNT pictures of the split `val` of a data set (name below its folder -> file).

    They are from different videos, as far as the first MANY samples have them. Only Parquet files are read.
    """
    videos: dict[str, list[dict[str, Any]]] = {}
    rows = (row for name in tables(files).get("val", ()) if name.endswith(".parquet") for row in _rows(files[name]))
    for row in islice(rows, MANY):
        videos.setdefault(row["video"], []).append(row)
    return _chosen(_sample(row) for row in _in_turns(list(videos.values())))


def _rows(path: Path) -> Iterator[dict[str, Any]]:
    """Read pictures with tasks. SourceError for a file without these columns."""
    try:
        with pq.ParquetFile(path) as file:
            missing = [name for name in COLUMNS if name not in file.schema_arrow.names]
            if missing:
                raise ValueError(f"no {', '.join(missing)}")
            for batch in file.iter_batches(64, columns=list(COLUMNS), use_threads=False):
                yield from batch.to_pylist()
    except (OSError, ValueError) as error:
        raise SourceError(str(path), f"a table with {', '.join(COLUMNS)}", str(error), "pack the data set again") from error


def _in_turns(rooms: list[list[Any]]) -> list[Any]:
    """Interleave: the first of each room, the second of each, ..."""
    return [room[n] for n in range(max(map(len, rooms), default=0)) for room in rooms if n < len(room)]


def _chosen(made: Iterable[Example | None]) -> list[Example]:
    """Keep the first example of each task, at most COUNT."""
    found: dict[str, Example] = {}
    for one in made:
        if one and len(found) < COUNT:
            found.setdefault(one.task, one)
        if len(found) == COUNT:
            break
    return list(found.values())


def _still(path: Path) -> Example | None:
    """Crop the black bars from a still; None without a task, or for a picture that is too small."""
    task = str(json.loads((path.parent / ANNOTATION).read_text(encoding="utf-8")).get("narration") or "")
    rgb = read_image(path)
    seen = rgb.max(axis=(1, 2)).nonzero()[0]
    return _example(task, rgb[seen[0] : seen[-1] + 1]) if len(seen) else None


def _sample(row: dict[str, Any]) -> Example | None:
    return _example(str(row["narration"] or ""), decode_image(row["image"]["bytes"] or b"", "column `image`"))


def _example(task: str, rgb: np.ndarray) -> Example | None:
    if not task or min(rgb.shape[:2]) < MIN_SIDE_PX:
        return None
    scale = min(1.0, MAX_SIDE_PX / max(rgb.shape[:2]))
    return Example(task, jpeg(cv2.resize(rgb, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)))
