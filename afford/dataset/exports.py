"""Exports as COCO and as WebDataset.

COCO: `images/<split>/` and `annotations/<split>.json`, with masks as exact run lengths or as polygons of outer contours.
WebDataset: tar shards with `<n>.jpg`, `<n>.mask_left.png`, ..., `<n>.json` for each sample. Both can also contain the original
frames, with hands.
"""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from afford.dataset import load, masks, metadata
from afford.dataset.table_schema import MASKS
from schemas.affordance import TAXONOMY

CATEGORIES = {
    "mask_left": ("left affordance", "affordance"),
    "mask_right": ("right affordance", "affordance"),
    "object_left_mask": ("left object", "object"),
    "object_right_mask": ("right object", "object"),
}
COCO_FACTS = ("sample_id", "video", "frame", "narration", "verb", "noun", "object_left", "object_right", "quality")
COCO_COLUMNS = ("image", "width", "height", "taxonomy", "provenance", *COCO_FACTS,
           *(f"{name}_{part}" for name in MASKS for part in ("rle", "area", "bbox")))
COCO_LAYOUT = ("Images are in `images/<split>/`, their masks (left and right affordance, left and right object) in "
               "`annotations/<split>.json` as {masks}.")
OriginalFrame = Callable[[str, int], bytes]
"""function of a row's `provenance` and `frame` that returns the JPEG of the frame with hands"""


def export_coco(
    dataset_root: Path, out: Path, polygons: bool = False, original_frame: OriginalFrame | None = None
) -> list[Path]:
    """Export every split as COCO, with a README.md; return the files.

    `polygons`: masks as polygons of their outer contours, without holes, instead of run lengths. `original_frame`: also write
    the frames with hands to `originals/<split>/`.
    """
    splits, info = load.splits(dataset_root), metadata.read_info(dataset_root)
    layout = COCO_LAYOUT.format(masks="polygons of outer contours, without holes" if polygons else "exact run lengths")
    layout += " Frames with hands are in `originals/<split>/`." if original_frame else ""
    export = _CocoExport(dataset_root, out, info, polygons, original_frame)
    readme = metadata.write_export_readme(info, out, "COCO", layout)
    return [readme, *(path for split in splits for path in _coco_split(export, split))]


@dataclass(frozen=True)
class _CocoExport:
    root: Path
    out: Path
    info: metadata.PackedInfo
    polygons: bool
    original_frame: OriginalFrame | None


def _coco_split(export: _CocoExport, split: str) -> Iterator[Path]:
    images: list[str] = []
    annotations: list[str] = []
    for number, row in enumerate(load.rows(export.root, split, COCO_COLUMNS), 1):
        name = f"{split}/{row['sample_id']}.jpg"
        yield _write_bytes(export.out / "images" / name, row["image"]["bytes"])
        image = _image(row, number, name)
        if export.original_frame:
            jpeg = export.original_frame(row["provenance"], row["frame"])
            yield _write_bytes(export.out / "originals" / name, jpeg)
            image["original_file_name"] = name
        images.append(_line(image))
        annotations += [_line(one) for one in _annotations(row, number, len(annotations) + 1, export.polygons)]
    yield _write(export.out / "annotations" / f"{split}.json", export.info, images, annotations)


def _write_bytes(path: Path, data: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def _image(row: dict[str, Any], number: int, file_name: str) -> dict[str, Any]:
    facts = {name: row[name] for name in COCO_FACTS}
    return {"id": number, "file_name": file_name, "width": row["width"], "height": row["height"], "license": 1,
            "taxonomy": TAXONOMY[row["taxonomy"]], **facts}


def _annotations(row: dict[str, Any], image: int, first: int, polygons: bool) -> list[dict[str, Any]]:
    """Return one annotation per non-empty mask."""
    kinds = [(category, name) for category, name in enumerate(MASKS, 1) if row[f"{name}_area"]]
    return [
        {"id": first + n, "image_id": image, "category_id": category, "iscrowd": 0, "area": row[f"{name}_area"],
         "bbox": row[f"{name}_bbox"], "segmentation": _segmentation(row, name, polygons)}
        for n, (category, name) in enumerate(kinds)
    ]


def _segmentation(row: dict[str, Any], name: str, polygons: bool) -> dict[str, Any] | list[list[float]]:
    height, width, counts = row["height"], row["width"], row[f"{name}_rle"]
    if polygons:
        return trace_polygons(masks.decode_rle([counts], height, width)[0])
    return {"size": [height, width], "counts": counts}


def trace_polygons(mask: np.ndarray) -> list[list[float]]:
    """Trace the outer borders of a mask (h, w) bool as polygons [x0, y0, x1, y1, ...] in px; holes are lost.

    As in COCO, pixel (x, y) covers [x, x + 1] x [y, y + 1]. The mask is drawn on a grid of half pixels, on which pixel borders
    are points: contours of the mask itself would run through pixel centres, half a pixel inside.
    """
    height, width = mask.shape
    grid = np.zeros((2 * height + 1, 2 * width + 1), np.uint8)
    for dy in range(3):
        for dx in range(3):
            grid[dy : dy + 2 * height : 2, dx : dx + 2 * width : 2] |= mask
    found, _ = cv2.findContours(grid, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [(contour.reshape(-1) / 2).tolist() for contour in found]


def _write(path: Path, info: metadata.PackedInfo, images: list[str], annotations: list[str]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    kinds = [{"id": n, "name": CATEGORIES[name][0], "supercategory": CATEGORIES[name][1]} for n, name in enumerate(MASKS, 1)]
    about = {"description": f"{info.name}: where to put each hand on an object for a narrated task", "version": info.version,
             "contributor": "afford"}
    url = metadata.licence_url(info.licence)
    licence = {"id": 1, "name": info.licence} | ({"url": url} if url else {})
    parts = {"licenses": [_line(licence)], "categories": [_line(kind) for kind in kinds], "images": images,
             "annotations": annotations}
    body = ",\n".join(f'"{name}": [\n' + ",\n".join(lines) + "\n]" for name, lines in parts.items())
    path.write_text("{\n" + f'"info": {_line(about)},\n' + body + "\n}\n", encoding="utf-8", newline="\n")
    return path


def _line(content: dict[str, Any]) -> str:
    return json.dumps(content, ensure_ascii=False, allow_nan=False)


SAMPLES_PER_TAR = 1000
TAR_FACTS = ("sample_id", "video", "clip", "participant", "frame", "time_ns", "narration", "verb", "noun", "verb_class",
         "noun_class", "object_left", "object_right", "quality", "inpaint_confidence", "key_distance",
         "motion_time_ns", "provenance")
TAR_COLUMNS = (*TAR_FACTS, "image", "taxonomy", "motion", *MASKS)
TAR_LAYOUT = ("Each sample of `<split>-<shard>.tar` is `<key>.jpg` (image without hands), one 1-bit `<key>.<mask>.png` per "
              "mask, and `<key>.json` (words and numbers).")


def export_webdataset(dataset_root: Path, out: Path, original_frame: OriginalFrame | None = None) -> list[Path]:
    """Export every split as WebDataset shards, with a README.md; return the files.

    `original_frame`: also write the frame with hands of each sample, as `<key>.original.jpg`.
    """
    splits, info = load.splits(dataset_root), metadata.read_info(dataset_root)
    layout = TAR_LAYOUT + (" Frames with hands are `<key>.original.jpg`." if original_frame else "")
    readme = metadata.write_export_readme(info, out, "WebDataset", layout)
    return [readme, *(path for split in splits for path in _tar_split(dataset_root, split, out, original_frame))]


def _tar_split(root: Path, split: str, out: Path, original_frame: OriginalFrame | None) -> Iterator[Path]:
    numbered = enumerate(load.rows(root, split, TAR_COLUMNS))
    shard = 0
    while group := list(islice(numbered, SAMPLES_PER_TAR)):
        path = out / f"{split}-{shard:06d}.tar"
        with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as tar:
            for n, row in group:
                _add(tar, f"{n:09d}", row, original_frame)
        yield path
        shard += 1


def _add(tar: tarfile.TarFile, key: str, row: dict[str, Any], original_frame: OriginalFrame | None) -> None:
    facts = {name: row[name] for name in TAR_FACTS} | {"taxonomy": TAXONOMY[row["taxonomy"]], "motion": _without_nan(row["motion"])}
    _add_file(tar, f"{key}.jpg", row["image"]["bytes"])
    if original_frame:
        _add_file(tar, f"{key}.original.jpg", original_frame(row["provenance"], row["frame"]))
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
