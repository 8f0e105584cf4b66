"""Exports as COCO and as WebDataset.

COCO: `images/<split>/` and `annotations/<split>.json`, with masks as exact run lengths. WebDataset: tar shards with `<n>.jpg`,
`<n>.mask_left.png`, ..., `<n>.json` for each sample.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

from afford.dataset import load
from afford.dataset.table_schema import MASKS
from schemas.affordance import TAXONOMY

CATEGORIES = {
    "mask_left": ("left affordance", "affordance"),
    "mask_right": ("right affordance", "affordance"),
    "object_left_mask": ("left object", "object"),
    "object_right_mask": ("right object", "object"),
}
COCO_FACTS = ("sample_id", "video", "frame", "narration", "verb", "noun", "object_left", "object_right", "quality")
COCO_COLUMNS = ("image", "width", "height", "taxonomy", *COCO_FACTS,
           *(f"{name}_{part}" for name in MASKS for part in ("rle", "area", "bbox")))


def export_coco(dataset_root: Path, out: Path) -> list[Path]:
    """Export every split as COCO; return the files."""
    return [path for split in load.splits(dataset_root) for path in _coco_split(dataset_root, split, out)]


def _coco_split(root: Path, split: str, out: Path) -> Iterator[Path]:
    images: list[str] = []
    annotations: list[str] = []
    folder = out / "images" / split
    folder.mkdir(parents=True, exist_ok=True)
    for number, row in enumerate(load.rows(root, split, COCO_COLUMNS), 1):
        path = folder / f"{row['sample_id']}.jpg"
        path.write_bytes(row["image"]["bytes"])
        yield path
        images.append(_line(_image(row, number, path.relative_to(out / "images").as_posix())))
        annotations += [_line(one) for one in _annotations(row, number, len(annotations) + 1)]
    yield _write(out / "annotations" / f"{split}.json", images, annotations)


def _image(row: dict[str, Any], number: int, file_name: str) -> dict[str, Any]:
    facts = {name: row[name] for name in COCO_FACTS}
    return {"id": number, "file_name": file_name, "width": row["width"], "height": row["height"],
            "taxonomy": TAXONOMY[row["taxonomy"]], **facts}


def _annotations(row: dict[str, Any], image: int, first: int) -> list[dict[str, Any]]:
    """Return one annotation per non-empty mask."""
    kinds = [(category, name) for category, name in enumerate(MASKS, 1) if row[f"{name}_area"]]
    return [
        {"id": first + n, "image_id": image, "category_id": category, "iscrowd": 0, "area": row[f"{name}_area"],
         "bbox": row[f"{name}_bbox"], "segmentation": {"size": [row["height"], row["width"]], "counts": row[f"{name}_rle"]}}
        for n, (category, name) in enumerate(kinds)
    ]


def _write(path: Path, images: list[str], annotations: list[str]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    kinds = [{"id": n, "name": CATEGORIES[name][0], "supercategory": CATEGORIES[name][1]} for n, name in enumerate(MASKS, 1)]
    parts = {"categories": [_line(kind) for kind in kinds], "images": images, "annotations": annotations}
    body = ",\n".join(f'"{name}": [\n' + ",\n".join(lines) + "\n]" for name, lines in parts.items())
    path.write_text("{\n" + body + "\n}\n", encoding="utf-8", newline="\n")
    return path


def _line(content: dict[str, Any]) -> str:
    return json.dumps(content, ensure_ascii=False, allow_nan=False)


SAMPLES_PER_TAR = 1000
TAR_FACTS = ("sample_id", "video", "clip", "participant", "frame", "time_ns", "narration", "verb", "noun", "verb_class",
         "noun_class", "object_left", "object_right", "quality", "inpaint_confidence", "key_distance",
         "motion_time_ns", "provenance")
TAR_COLUMNS = (*TAR_FACTS, "image", "taxonomy", "motion", *MASKS)


def export_webdataset(dataset_root: Path, out: Path) -> list[Path]:
    """Export every split as WebDataset shards; return the files."""
    out.mkdir(parents=True, exist_ok=True)
    return [path for split in load.splits(dataset_root) for path in _tar_split(dataset_root, split, out)]


def _tar_split(root: Path, split: str, out: Path) -> Iterator[Path]:
    numbered = enumerate(load.rows(root, split, TAR_COLUMNS))
    shard = 0
    while group := list(islice(numbered, SAMPLES_PER_TAR)):
        path = out / f"{split}-{shard:06d}.tar"
        with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as tar:
            for n, row in group:
                _add(tar, f"{n:09d}", row)
        yield path
        shard += 1


def _add(tar: tarfile.TarFile, key: str, row: dict[str, Any]) -> None:
    facts = {name: row[name] for name in TAR_FACTS} | {"taxonomy": TAXONOMY[row["taxonomy"]], "motion": _without_nan(row["motion"])}
    _add_file(tar, f"{key}.jpg", row["image"]["bytes"])
    for name in MASKS:
        _add_file(tar, f"{key}.{name}.png", row[name]["bytes"])
    _add_file(tar, f"{key}.json", json.dumps(facts, ensure_ascii=False, allow_nan=False).encode("utf-8"))


def _without_nan(motion: dict[str, list[list[float]]]) -> dict[str, list[list[float] | None]]:
    """Replace points out of sight (NaN) by null, since JSON has no NaN."""
    return {name: [None if x != x or y != y else [x, y] for x, y in path] for name, path in motion.items()}


def _add_file(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    """Add a file with the fixed owner, time and mode of a new TarInfo."""
    info = tarfile.TarInfo(name)
    info.size = len(data)
    tar.addfile(info, io.BytesIO(data))
