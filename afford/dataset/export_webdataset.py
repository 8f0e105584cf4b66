"""The data set as WebDataset tar shards: `<n>.jpg`, `<n>.mask_left.png`, ..., `<n>.json` side by side."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from afford.dataset import load
from afford.dataset.columns import MASKS
from schemas.affordance import TAXONOMY

SAMPLES_PER_TAR = 1000
FACTS = ("sample_id", "video", "clip", "participant", "frame", "time_ns", "narration", "verb", "noun", "verb_class",
         "noun_class", "object_left", "object_right", "quality", "inpaint_confidence", "key_distance",
         "motion_time_ns", "provenance")
COLUMNS = (*FACTS, "image", "taxonomy", "motion", *MASKS)


def export(dataset_root: Path, out: Path) -> list[Path]:
    """Write every split; returns the files."""
    out.mkdir(parents=True, exist_ok=True)
    return [path for split in load.splits(dataset_root) for path in _split(dataset_root, split, out)]


def _split(root: Path, split: str, out: Path) -> Iterator[Path]:
    numbered = enumerate(load.rows(root, split, COLUMNS))
    shard = 0
    while group := list(islice(numbered, SAMPLES_PER_TAR)):
        path = out / f"{split}-{shard:06d}.tar"
        with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as tar:
            for n, row in group:
                _add(tar, f"{n:09d}", row)
        yield path
        shard += 1


def _add(tar: tarfile.TarFile, key: str, row: dict[str, Any]) -> None:
    facts = {name: row[name] for name in FACTS} | {"taxonomy": TAXONOMY[row["taxonomy"]], "motion": _without_nan(row["motion"])}
    _file(tar, f"{key}.jpg", row["image"]["bytes"])
    for name in MASKS:
        _file(tar, f"{key}.{name}.png", row[name]["bytes"])
    _file(tar, f"{key}.json", json.dumps(facts, ensure_ascii=False, allow_nan=False).encode("utf-8"))


def _without_nan(motion: dict[str, list[list[float]]]) -> dict[str, list[list[float] | None]]:
    """JSON has no NaN: a point out of sight is null."""
    return {name: [None if x != x or y != y else [x, y] for x, y in path] for name, path in motion.items()}


def _file(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    """Owner, time and mode are those of a new TarInfo: fixed."""
    info = tarfile.TarInfo(name)
    info.size = len(data)
    tar.addfile(info, io.BytesIO(data))
