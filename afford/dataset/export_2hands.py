"""Export in the released format of 2HandedAfforder: one HDF5 and one JSON file per video, masks as outer contours.

`<split>/h5/<start>-<end>_<video>.h5` contains images (BGR), words and one-hot taxonomy under `data`; `<split>/jsons/` contains
the contours by row number. start-end is the inclusive range of the split's running index. Holes of masks are lost, since the
format stores outer contours only.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from itertools import groupby, islice
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np

from afford.dataset import load, masks, metadata
from afford.dataset.table_schema import MASKS
from schemas.affordance import TAXONOMY

CONTOURS = ("aff_left", "aff_right", "obj_left", "obj_right")
STRINGS = {"obj_id_left": "object_left", "obj_id_right": "object_right", "noun": "noun", "verb": "verb",
           "narration": "narration"}
COLUMNS = ("video", "image", "taxonomy", "height", "width", *STRINGS.values(), *(f"{name}_rle" for name in MASKS))


LAYOUT = ("Each video is `<split>/h5/<start>-<end>_<video>.h5` with images (BGR), words and one-hot taxonomy, and "
          "`<split>/jsons/<start>-<end>_<video>.json` with the outer contours of the masks.")


def export(dataset_root: Path, out: Path) -> list[Path]:
    """Export every split, with a README.md; return the files."""
    splits = load.splits(dataset_root)
    readme = metadata.write_export_readme(metadata.read_info(dataset_root), out, "2HANDS, as released with 2HandedAfforder", LAYOUT)
    return [readme, *(path for split in splits for path in _split(dataset_root, split, out / split))]


def _split(root: Path, split: str, out: Path) -> Iterator[Path]:
    count = Counter(row["video"] for row in load.rows(root, split, ["video"]))
    start = 0
    for video, group in groupby(load.rows(root, split, COLUMNS), lambda row: row["video"]):
        name = f"{start}-{start + count[video] - 1}_{video}"
        paths = out / "h5" / f"{name}.h5", out / "jsons" / f"{name}.json"
        for path in paths:
            path.parent.mkdir(parents=True, exist_ok=True)
        _video(group, count[video], *paths)
        yield from paths
        start += count[video]


def _video(rows: Iterator[dict[str, Any]], count: int, h5_path: Path, json_path: Path) -> None:
    outlines: dict[str, Any] = {}
    with h5py.File(h5_path, "w") as file:
        data: dict[str, Any] = {}
        for n, row in enumerate(islice(rows, count)):
            if n == 0:
                data = _datasets(file.create_group("data"), count, row["height"], row["width"])
            image = cv2.imdecode(np.frombuffer(row["image"]["bytes"], np.uint8), cv2.IMREAD_COLOR)
            data["inpainted"][n] = image
            data["taxonomy"][n] = np.eye(len(TAXONOMY), dtype=np.uint8)[row["taxonomy"]]
            for key, column in STRINGS.items():
                data[key][n] = row[column]
            outlines[str(n)] = _outlines(row)
    json_path.write_text(json.dumps(outlines), encoding="utf-8")


def _datasets(group: Any, count: int, height: int, width: int) -> dict[str, Any]:
    words = {key: group.create_dataset(key, (count,), h5py.string_dtype()) for key in STRINGS}
    image = group.create_dataset("inpainted", (count, height, width, 3), np.uint8, chunks=(1, height, width, 3),
                                 compression="gzip", compression_opts=1)
    return words | {"inpainted": image, "taxonomy": group.create_dataset("taxonomy", (count, len(TAXONOMY)), np.uint8)}


def _outlines(row: dict[str, Any]) -> dict[str, Any]:
    planes = masks.decode_rle([row[f"{name}_rle"] for name in MASKS], row["height"], row["width"])
    found = {key: contours(plane) for key, plane in zip(CONTOURS, planes, strict=True)}
    return {"original_size": [row["height"], row["width"]], **found}


def contours(mask: np.ndarray) -> list[list[list[int]]]:
    """Trace the outer contours of a mask (h, w) bool, each a list of [x, y]."""
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [np.asarray(contour, np.int32).reshape(-1, 2).tolist() for contour in found]


def fill(outlines: list[list[list[int]]], height: int, width: int) -> np.ndarray:
    """Fill contours as a mask (h, w) bool, like the released decoder."""
    plane = np.zeros((height, width), np.uint8)
    cv2.drawContours(plane, [np.array(outline, np.int32).reshape(-1, 1, 2) for outline in outlines], -1, 1, cv2.FILLED)
    return plane.view(bool)


def first_row(name: str) -> int:
    """Return the running index of the first sample of `<start>-<end>_<video>.h5`."""
    return int(name.split("-")[0])


def read_sample(h5_path: Path, row: int, outlines: dict[str, Any]) -> dict[str, Any]:
    """Read a sample of a video and draw its outlines.

    Returns `image` (h, w, 3) RGB, `masks` (4, h, w) bool, `taxonomy` one-hot, and words.
    """
    size = outlines["original_size"]
    with h5py.File(h5_path) as file:
        data = file["data"]
        return {
            "image": data["inpainted"][row][..., ::-1],
            "masks": np.stack([fill(outlines[key], *size) for key in CONTOURS]),
            "taxonomy": data["taxonomy"][row],
            **{key: data[key][row].decode("utf-8") for key in STRINGS},
        }
