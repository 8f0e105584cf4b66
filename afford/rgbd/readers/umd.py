"""UMD part affordance (Myers et al. 2015) -> static samples.

    <root>/[part-affordance-dataset/]category_split.txt      lines `1 bowl_01` (train) or `2 bowl_02` (test); every category in both
    <root>/[part-affordance-dataset/]novel_split.txt         the same, whole categories held out
    <root>/[...]tools/bowl_01/bowl_01_00000001_{rgb.jpg, depth.png, label.mat}

`label.mat` holds gt_label (480, 640): 0 background, then CLASSES. Depth is 16 bit; that it is in millimetres, 0 = none, is our
assumption. Intrinsics are not given. Of our nine affordances only grasp, cut and hammer are there; the rest become background.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import PurePosixPath

import cv2
import numpy as np

from afford.common.errors import SourceError
from afford.common.text import read_utf8
from afford.dataset.sor3d_layout import DEPTH_MM
from afford.rgbd.readers import Umd
from afford.rgbd.readers.mat5 import read_matrix
from afford.rgbd.readers.static_set import UMD_LABEL, PictureEntry, centre_crop, decode_picture, map_labels
from schemas.files import FileRef, FileTree
from schemas.interaction import AFFORDANCES, BACKGROUND, StaticSample

CLASSES = ("grasp", "cut", "scoop", "contain", "pound", "support", "wrap-grasp")
OURS = {"grasp": "grasp", "cut": "cut", "pound": "hammer", "wrap-grasp": "grasp"}
TABLE = np.array([BACKGROUND, *(AFFORDANCES.index(OURS[c]) if c in OURS else BACKGROUND for c in CLASSES)], np.uint8)
SPLITS = {"1": "train", "2": "test"}
RGB, DEPTH = "_rgb.jpg", "_depth.png"
FIX = "compare with the layout in docs/rgbd/interaction-data.md"


def list_pictures(files: FileTree, crop_px: int, every: int, params: Umd) -> tuple[PictureEntry, ...]:
    """List every n-th labelled picture of each tool, by name (`ListPictures`).

    People labelled every third frame; the other labels were interpolated.
    """
    splits = _splits(files, params.split_file)
    by_name = {file.name: file for file in files.files}
    tools: dict[str, list[FileRef]] = {}
    for file in files.files:
        if file.name.endswith(UMD_LABEL):
            tools.setdefault(PurePosixPath(file.name).parent.name, []).append(file)
    if not tools:
        raise SourceError(files.name, "tools/<tool>/<tool>_<frame>_label.mat", "no such file", FIX)
    return tuple(PictureEntry(splits.get(tool, ""), partial(_sample, label, by_name, tool, splits.get(tool, ""), crop_px))
                 for tool, labels in sorted(tools.items()) for label in sorted(labels, key=lambda f: f.name)[::every])  # fmt: skip


def _splits(files: FileTree, split_file: str) -> dict[str, str]:
    """Map each tool to train or test; empty without the file."""
    file = next((f for f in files.files if PurePosixPath(f.name).name == split_file), None)
    if file is None:
        return {}
    out = {}
    for number, line in enumerate(read_utf8(file.path, file.name).splitlines(), 1):
        words = line.split()
        if words and (len(words) != 2 or words[0] not in SPLITS):
            raise SourceError(f"{file.name}, line {number}", "1 or 2, then a tool", repr(line), FIX)
        if words:
            out[words[1]] = SPLITS[words[0]]
    return out


def _sample(label: FileRef, by_name: Mapping[str, FileRef], tool: str, split: str, crop_px: int) -> StaticSample:
    stem = label.name.removesuffix(UMD_LABEL)
    if stem + RGB not in by_name:
        raise SourceError(label.name, f"{PurePosixPath(stem).name}{RGB} beside it", "nothing", FIX)
    rgb = decode_picture(by_name[stem + RGB], cv2.IMREAD_COLOR, np.uint8, 3)[..., ::-1]
    raw = decode_picture(by_name[stem + DEPTH], cv2.IMREAD_UNCHANGED, np.uint16, 2) if stem + DEPTH in by_name else None
    marked = map_labels(_label(label), TABLE, f"{label.name}, gt_label")
    depth = [] if raw is None else [(raw / DEPTH_MM).astype(np.float32)]
    (rgb, marked, *depth), _ = centre_crop(label.name, crop_px, rgb, marked, *depth)
    return StaticSample(PurePosixPath(stem).name, "umd", split, tool.rpartition("_")[0] or tool,
                        np.ascontiguousarray(rgb), np.stack(depth) if depth else np.zeros((0, *marked.shape), np.float32), marked,
                        np.zeros((0, 3, 3)))  # fmt: skip


def _label(file: FileRef) -> np.ndarray:
    """Labels (h, w) of gt_label; a .mat of arrays holds no code that could run."""
    label = read_matrix(file.path.read_bytes(), "gt_label", file.name)
    if label is None or label.ndim != 2 or label.dtype.kind not in "ui":
        got = "nothing" if label is None else f"{label.dtype} {label.shape}"
        raise SourceError(f"{file.name}, gt_label", "an image of whole numbers", got, FIX)
    return np.asarray(label)
