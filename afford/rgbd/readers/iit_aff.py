"""IIT-AFF (Nguyen et al. 2017) -> static samples.

    <root>/train_and_val.txt, val.txt, test.txt        names of pictures, a line each
    <root>/rgb/NAME.jpg
    <root>/affordances_labels/NAME.txt                 rows of whole numbers, 0 background, then CLASSES
    <root>/depth/NAME.txt (or deep/)                   rows of numbers; that they are metres is our assumption
    <root>/object_labels/NAME.txt                      `class xmin ymin xmax ymax` a line; OBJECTS

Of our nine affordances grasp, cut and hammer are there; the rest become background. Intrinsics are not given.
"""

from __future__ import annotations

from functools import partial
from pathlib import PurePosixPath

import cv2
import numpy as np

from afford.common.errors import SourceError
from afford.common.text import read_utf8
from afford.rgbd.readers.static_set import PictureEntry, centre_crop, decode_picture, map_labels
from schemas.files import FileRef, FileTree
from schemas.interaction import AFFORDANCES, BACKGROUND, StaticSample

CLASSES = ("contain", "cut", "display", "engine", "grasp", "hit", "pound", "support", "w-grasp")
OURS = {"cut": "cut", "grasp": "grasp", "hit": "hammer", "pound": "hammer", "w-grasp": "grasp"}
TABLE = np.array([BACKGROUND, *(AFFORDANCES.index(OURS[c]) if c in OURS else BACKGROUND for c in CLASSES)], np.uint8)
OBJECTS = ("bowl", "tvm", "pan", "hammer", "knife", "cup", "drill", "racket", "spatula", "bottle")
SPLIT_FILES = (("test.txt", "test"), ("val.txt", "val"), ("train_and_val.txt", "train"))
"""split files by priority: the first one that names a picture decides"""
FIX = "compare with the layout in docs/rgbd/interaction-data.md"


def list_pictures(files: FileTree, crop_px: int, every: int, params: None) -> tuple[PictureEntry, ...]:
    """List every n-th picture that has a label, by name (`ListPictures`)."""
    at = {tuple(PurePosixPath(f.name).parts[-2:]): f for f in files.files}
    labels = sorted(stem for folder, stem in ((k[0], PurePosixPath(k[-1]).stem) for k in at) if folder == "affordances_labels")
    if not labels:
        raise SourceError(files.name, "affordances_labels/<picture>.txt", "no such file", FIX)
    splits = _splits(files)
    chosen = [(stem, splits.get(stem, "")) for stem in labels[::every]]
    return tuple(PictureEntry(split, partial(_sample, stem, at, split, crop_px)) for stem, split in chosen)


def _splits(files: FileTree) -> dict[str, str]:
    out: dict[str, str] = {}
    for name, split in SPLIT_FILES:
        for file in files.files:
            if PurePosixPath(file.name).name == name:
                for line in read_utf8(file.path, file.name).split():
                    out.setdefault(PurePosixPath(line).stem, split)
    return out


def _sample(stem: str, at: dict[tuple[str, ...], FileRef], split: str, crop_px: int) -> StaticSample:
    source = at.get(("rgb", f"{stem}.jpg")) or at.get(("rgb", f"{stem}.png"))
    if source is None:
        raise SourceError(f"rgb/{stem}.jpg", "the picture of a label", "nothing", FIX)
    rgb = decode_picture(source, cv2.IMREAD_COLOR, np.uint8, 3)[..., ::-1]
    marks = at["affordances_labels", f"{stem}.txt"]
    label = map_labels(_rows(marks).astype(np.int64), TABLE, marks.name)
    far = at.get(("depth", f"{stem}.txt")) or at.get(("deep", f"{stem}.txt"))
    depth = [] if far is None else [np.maximum(_rows(far), 0).astype(np.float32)]
    (rgb, label, *depth), _ = centre_crop(source.name, crop_px, rgb, label, *depth)
    return StaticSample(stem, "iit-aff", split, _thing(at.get(("object_labels", f"{stem}.txt"))),
                        np.ascontiguousarray(rgb), np.stack(depth) if depth else np.zeros((0, *label.shape), np.float32), label,
                        np.zeros((0, 3, 3)))  # fmt: skip


def _rows(file: FileRef) -> np.ndarray:
    """Numbers (h, w) float64 of a text table; SourceError when rows differ in length or hold anything else."""
    lines = read_utf8(file.path, file.name).splitlines()
    try:
        found = np.array([line.split() for line in lines if line.strip()], np.float64)
    except ValueError as error:
        raise SourceError(file.name, "rows of numbers of one length", str(error), FIX) from error
    if found.ndim != 2 or not np.isfinite(found).all():
        raise SourceError(file.name, "rows of finite numbers", f"shape {found.shape}", FIX)
    return found


def _thing(file: FileRef | None) -> str:
    """Class of the object with the largest box; '' without boxes."""
    if file is None:
        return ""
    boxes = _rows(file)
    if boxes.shape[1:] != (5,) or not ((boxes[:, 0] >= 0) & (boxes[:, 0] < len(OBJECTS))).all():
        raise SourceError(file.name, f"rows of class 0 to {len(OBJECTS) - 1}, xmin, ymin, xmax, ymax", f"shape {boxes.shape}", FIX)
    area = (boxes[:, 3] - boxes[:, 1]) * (boxes[:, 4] - boxes[:, 2])
    return OBJECTS[int(boxes[int(area.argmax()), 0])]
