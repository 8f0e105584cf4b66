"""UTKinect-Action3D (Xia et al. 2012) -> clips of actions, for pre-training.

    <root>/actionLabel.txt                    `s01_e01`, then `walk: 252 390` a line, ten actions; NaN where an action is missing
    <root>/RGB/s01_e01/colorImg252.jpg        640 x 480; numbers with gaps
    <root>/depth/s01_e01/depthImg252.xml      OpenCV's XML with width, height and data: 320 x 240

Depth values carry three low bits of the player's index, as the Kinect SDK wrote them (value >> 3 = millimetres): our assumption.
Frames without a picture are left out; where depth is missing for one frame of a clip, the clip has none.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import PurePosixPath

import cv2
import numpy as np

from afford.common.errors import SourceError
from afford.common.text import read_utf8
from afford.dataset.sor3d_layout import DEPTH_MM
from afford.rgbd.readers.static_set import decode_picture
from schemas.files import FileRef, FileTree
from schemas.interaction import ActionClip

LABELS = "actionLabel.txt"
PICTURE = re.compile(r"colorImg(0|[1-9][0-9]{0,17})\.jpg")
PLAYER_BITS = 3
FIX = "compare with the layout in docs/rgbd/interaction-data.md"


def read_actions(files: FileTree, size_px: int, most_frames: int) -> tuple[ActionClip, ...]:
    """Read all actions of all sequences, by name.

    Pictures are resized to `size_px` squares; frames are spread evenly over an action.
    """
    table = next((f for f in files.files if PurePosixPath(f.name).name == LABELS), None)
    if table is None:
        raise SourceError(files.name, LABELS, "no such file", FIX)
    at = {PurePosixPath(f.name).parts[-2:]: f for f in files.files if len(PurePosixPath(f.name).parts) >= 2}
    shown = _shown(at)
    found = [_clip(row, at, shown, size_px, most_frames) for row in _rows(table)]
    clips = tuple(clip for clip in found if clip is not None)
    if not clips:
        raise SourceError(files.name, "RGB/<sequence>/colorImg<number>.jpg of an action", "no such file", FIX)
    return clips


def _rows(table: FileRef) -> list[tuple[str, str, int, int]]:
    """Sequence, action, first and last frame number of each line."""
    out, sequence = [], ""
    for number, line in enumerate(read_utf8(table.path, table.name).splitlines(), 1):
        action, colon, numbers = (word.strip() for word in line.partition(":"))
        if action and not colon:
            sequence = action
        if not colon or "nan" in numbers.lower():
            continue
        try:
            first, last = (int(word) for word in numbers.split())
        except ValueError as error:
            raise SourceError(f"{table.name}, line {number}", "action: first last", repr(line), FIX) from error
        out.append((sequence, action, first, last))
    return out


def _shown(at: Iterable[tuple[str, ...]]) -> dict[str, list[int]]:
    """Frame numbers of each sequence's pictures, in order."""
    out: dict[str, list[int]] = {}
    for sequence, name in at:
        number = PICTURE.fullmatch(name)
        if number:
            out.setdefault(sequence, []).append(int(number[1]))
    return {sequence: sorted(numbers) for sequence, numbers in out.items()}


def _clip(row: tuple[str, str, int, int], at: dict[tuple[str, ...], FileRef], shown: dict[str, list[int]], size_px: int,
          most: int) -> ActionClip | None:  # fmt: skip
    sequence, action, first, last = row
    numbers = [k for k in shown.get(sequence, ()) if first <= k <= last]
    if not numbers:
        return None
    numbers = [numbers[k] for k in np.unique(np.linspace(0, len(numbers) - 1, min(most, len(numbers))).round().astype(int))]
    size = (size_px, size_px)
    pictures = (decode_picture(at[sequence, f"colorImg{k}.jpg"], cv2.IMREAD_COLOR, np.uint8, 3) for k in numbers)
    rgb = [cv2.resize(picture, size, interpolation=cv2.INTER_AREA) for picture in pictures]
    far = [at.get((sequence, f"depthImg{k}.xml")) for k in numbers]
    depth = np.zeros((len(numbers), *size), np.float32)
    if all(file is not None for file in far):
        depth = np.stack([cv2.resize(_depth(file), size, interpolation=cv2.INTER_NEAREST) for file in far if file is not None])
    return ActionClip(f"{sequence}_{action}", action, np.ascontiguousarray(np.stack(rgb)[..., ::-1]), depth)


def _depth(file: FileRef) -> np.ndarray:
    """Depth (h, w) float32 in metres."""
    data = file.path.read_bytes()
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise SourceError(file.name, "plain XML", "a document type", "get the file again from its source")
    try:
        root = ET.fromstring(data)
        width, height = (int(root.findtext(f".//{key}", "")) for key in ("width", "height"))
        values = np.array((root.findtext(".//data") or "").split(), np.int64).reshape(height, width)
    except (ET.ParseError, ValueError, OverflowError) as error:
        raise SourceError(file.name, "width, height and as many numbers in data", str(error), FIX) from error
    return np.asarray((values >> PLAYER_BITS) / DEPTH_MM, np.float32)
