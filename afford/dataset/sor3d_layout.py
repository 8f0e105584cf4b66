"""SOR3D-AFF's folder layout: folder names, discovery of sequences, label colours, and writer of sequences.

A sequence is `<split>/<SubjectN>_<action>_..._<object>/rgb/...`. Depth and camera files are an extension.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from afford.common.errors import SourceError
from afford.common.folders import Entry, entries
from schemas.files import FileRef, FileTree
from schemas.interaction import AFFORDANCES, BACKGROUND, COLOURS_BGR, InteractionClip

SPLITS = ("train", "val")
EXTRAS = 4
"""number of files at the end of rgb/ that are not frames: first the mask, last the hot spot; the two between are unused"""
MASK, SPOT = 0, 3
DEPTH_MM = 1000.0
CAMERA = "camera.json"


class SequenceName(NamedTuple):
    """Parsed name of a sequence folder."""

    split: str
    folder: str
    subject: str
    affordance: str
    object_type: str


def parse_name(path: str) -> SequenceName:
    """Parse the path of a file or folder of a sequence, relative to the root. Raises SourceError for another form."""
    split, _, rest = path.partition("/")
    folder = rest.partition("/")[0]
    words = folder.split("_")
    if split not in SPLITS or len(words) < 3:
        raise SourceError(path, "train/ or val/, then Subject_action_..._object", f"{split}/{folder}",
                          "name the folders as docs/rgbd/interaction-data.md says")  # fmt: skip
    if words[1] not in AFFORDANCES:
        raise SourceError(f"{split}/{folder}, second word", f"one of {', '.join(AFFORDANCES)}", repr(words[1]),
                          "rename the folder, or leave it out")  # fmt: skip
    return SequenceName(split, folder, words[0], words[1], words[-1])


Digest = Callable[[Path], str]


def discover_sequences(root: Path, digest: Digest) -> tuple[FileTree, ...]:
    """Index the sequences of a SOR3D-AFF root, train first, with names relative to the root.

    Raises SourceError when there is none, a file is outside the root, or two sequences have one name.
    """
    if not root.is_dir():
        raise SourceError(str(root), "a folder with train/ and val/", "a file" if root.exists() else "nothing", "give the root")
    found: dict[str, list[Entry]] = {}
    for entry in entries(root):
        words = entry.name.split("/")
        if len(words) >= 3 and words[0] in SPLITS:
            found.setdefault("/".join(words[:2]), []).append(entry)
    if not found:
        raise SourceError(str(root), "train/<Subject>_<action>_<object>/rgb/ or the same in val/", "no such folder",
                          "name the folders as docs/rgbd/interaction-data.md says")  # fmt: skip
    names = Counter(key.partition("/")[2] for key in found)
    twice = next((name for name, count in names.items() if count > 1), None)
    if twice is not None:
        raise SourceError(str(root), "sequences of one name only", f"{twice!r} in train and val", "rename one")
    return tuple(entry_tree(key.partition("/")[2], kept, digest) for key, kept in sorted(found.items()))


def entry_tree(name: str, kept: Iterable[Entry], digest: Digest) -> FileTree:
    """Index entries as a FileTree. Raises SourceError for a link out of the root."""
    refs = []
    for entry in kept:
        if entry.leaves:
            raise SourceError(entry.name, "a file below the root", "a link that leaves it", "copy the file there")
        refs.append(FileRef(entry.name, digest(entry.path), entry.path.stat().st_size, entry.path))
    return FileTree(name, tuple(sorted(refs, key=lambda ref: ref.name)))


def colour_label(label: np.ndarray) -> np.ndarray:
    """Colour a label (h, w) uint8 as a BGR image (h, w, 3) uint8, black for background.

    Raises ValueError for a label out of range.
    """
    table = np.array([*(COLOURS_BGR[name] for name in AFFORDANCES), (0, 0, 0)], np.uint8)
    if label.max(initial=0) > BACKGROUND:
        raise ValueError(f"label: expected 0 to {BACKGROUND}, got {int(label.max())}")
    return np.asarray(table[label])


def dominant_colour(picture: np.ndarray) -> tuple[int, int, int] | None:
    """Return the most frequent BGR colour of an image (h, w, 3) other than black; None when all pixels are black."""
    found, count = np.unique(picture.reshape(-1, 3), axis=0, return_counts=True)
    count[(found == 0).all(axis=-1)] = 0
    return tuple(found[count.argmax()].tolist()) if count.any() else None


def label_of_colours(picture: np.ndarray, affordance: str) -> np.ndarray:
    """Convert a BGR image (h, w, 3) to a label (h, w) uint8: the affordance where the colour is exactly its, else BACKGROUND."""
    hit = (picture == np.array(COLOURS_BGR[affordance], np.uint8)).all(axis=-1)
    return np.where(hit, np.uint8(AFFORDANCES.index(affordance)), np.uint8(BACKGROUND))


GRID = (1920, 1080)
"""Width and height of the grid of hot spots: the Kinect's colour camera, in whole pixels."""


def write_sequence(clip: InteractionClip, root: Path) -> Path:
    """Write `<split>/<name>/`: rgb/NNNN.png and the four extra files, depth/NNNN.png (16 bit, mm, 0 = hole), camera.json.

    Raises ValueError when a depth does not fit into 16 bits of millimetres.
    """
    folder = root / clip.split / clip.name
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    if clip.depth_m.max(initial=0) * DEPTH_MM > np.iinfo(np.uint16).max:
        raise ValueError(f"{clip.name}, depth_m: expected 65.535 m at most, got {float(clip.depth_m.max()):.3f} m")
    for number, (rgb, depth) in enumerate(zip(clip.rgb, clip.depth_m, strict=True), 1):
        _png(folder / "rgb" / f"{number:04d}.png", rgb[..., ::-1])
        _png(folder / "depth" / f"{number:04d}.png", np.round(depth * DEPTH_MM).astype(np.uint16))
    mask = colour_label(clip.label)
    _png(folder / "rgb" / "target_1_mask.png", mask)
    _png(folder / "rgb" / "target_2_frame.png", clip.rgb[-1][..., ::-1])
    _png(folder / "rgb" / "target_3_both.png", np.where(mask.any(axis=-1, keepdims=True), mask, clip.rgb[-1][..., ::-1]))
    _json(folder / "rgb" / "target_4_hotspot.json", {"center": _spots(clip)})
    K = clip.K
    _json(folder / CAMERA, {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2], "rate_hz": clip.rate_hz})
    return folder


def _spots(clip: InteractionClip) -> list[dict[str, int]]:
    height, width = clip.label.shape
    across, down = GRID[0] / width, GRID[1] / height
    return [{"x_coord": round(float(x) * across), "y_coord": round(float(y) * down), "radius": round(float(r) * across)}
            for x, y, r in clip.hotspot]  # fmt: skip


def _png(path: Path, picture: np.ndarray) -> None:
    done, data = cv2.imencode(".png", np.ascontiguousarray(picture), [cv2.IMWRITE_PNG_COMPRESSION, 3])
    if not done:
        raise ValueError(f"{path.name}: OpenCV cannot write {picture.dtype} {picture.shape} as PNG")
    path.write_bytes(data.tobytes())


def _json(path: Path, value: object) -> None:
    path.write_text(json.dumps(value), encoding="utf-8", newline="\n")
