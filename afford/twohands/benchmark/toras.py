"""True masks from TORAS annotations, with which ActAffordance was outlined (2HandedAfforder).

An export has one entry for each picture. `documents[0].name` ends in `frame_<frame>.png` (EPIC, after the video id) or in
`frame_<clip>_<frame>.png` (Ego4D). The entities are named after the hands, and the first Segmentation block counts. The left
512 x 512 px of the canvas are the inpainted image, which is resized to 855 x 855 by nearest neighbour. A pixel that an outline
touches belongs to the mask, as in the released grey PNGs.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from skimage.draw import polygon

from afford.common.errors import SourceError
from afford.common.text import json_field, parse_json
from afford.dataset.act_affordance import CaseFiles
from schemas.files import FileTree
from schemas.video import SIDES

CANVAS_PX, FULL_PX = 512, 855
FINE = 8
"""subpixels along each side of a pixel, in which outlines are drawn"""
EPIC = re.compile(r"(P\d\d_\d+)_.*frame_(\d+)\.\w+$")
EGO4D = re.compile(r"frame_(.+)_(\d+)\.\w+$")
Annotation = list[np.ndarray]
"""outlines that are filled together, even-odd: (p, 2) float x, y on the canvas"""


@dataclass(frozen=True)
class Toras:
    """Outlines by (video, frame) and hand, which are drawn on request."""

    outlines: dict[tuple[str, int], dict[str, list[Annotation]]]

    def __call__(self, files: CaseFiles, annotation: Any) -> np.ndarray:
        """Draw the regions of both hands, (2, h, w) bool; a crop is cut out of the whole by `target_box`."""
        hands = self.outlines.get((files.video, int(files.frame)))
        if hands is None:
            raise SourceError(files.where, "an entry of that video and frame in the TORAS file", "no such entry", "remove the case")
        whole = np.stack([draw(hands[side]) for side in SIDES])
        if files.protocol == "masks":
            return whole
        x0, y0, x1, y1 = _box(annotation, files.where)
        return whole[:, y0:y1, x0:x1]


def of_tree(files: FileTree) -> Toras:
    """Read all *toras_anns.json of a benchmark's folder. SourceError without such a file."""
    named = [ref for ref in files.files if ref.name.endswith("toras_anns.json")]
    if not named:
        raise SourceError(files.name, "a file toras_anns.json", "no such file", "score the PNG masks: --set score_cases.truth=png")
    return Toras({key: hands for ref in named for key, hands in read(ref.path.read_bytes(), ref.name).outlines.items()})


def read(data: bytes, name: str) -> Toras:
    """Read the outlines of an export. SourceError names the entry that cannot be used."""
    document = parse_json(data, name)
    if not isinstance(document, list):
        raise SourceError(name, "a list of annotated documents", type(document).__name__, "export the annotations from TORAS")
    found = {}
    for number, record in enumerate(document):
        where = f"{name}, entry {number}"
        if isinstance(record, dict) and record.get("annotation") is not None:
            found[_picture(record, where)] = _hands(record["annotation"], where)
    return Toras(found)


def _picture(record: Any, where: str) -> tuple[str, int]:
    name = json_field((json_field(record, "documents", list, where) or [{}])[0], "name", str, where)
    match = EPIC.search(name) or EGO4D.search(name)
    if match is None:
        raise SourceError(where, "a document named ..frame_<number>.png", repr(name), "compare with docs/twohands/benchmark.md")
    return match[1], int(match[2])


def _hands(annotation: Any, where: str) -> dict[str, list[Annotation]]:
    group = (json_field(annotation, "annotationGroups", list, where) or [{}])[0]
    hands: dict[str, list[Annotation]] = {"left": [], "right": []}
    for entity in json_field(group, "annotationEntities", list, where):
        name = json_field(entity, "name", str, where)
        side = next((side for side in hands if side in name), None)
        if side is None:
            raise SourceError(f"{where}, field 'name'", "left_hand or right_hand", repr(name), "rename the entity")
        hands[side] += _segmentation(entity, where)
    return hands


def _segmentation(entity: Any, where: str) -> list[Annotation]:
    """Outlines of the first Segmentation block; those of fewer than three corners are dropped."""
    for block in json_field(entity, "annotationBlocks", list, where):
        if block.get("blockName") == "Segmentation":
            drawn = [json_field(a, "segments", list, where) for a in json_field(block, "annotations", list, where)]
            return [[np.array(outline, np.float64) for outline in segments if len(outline) >= 3] for segments in drawn]
    return []


def draw(annotations: list[Annotation]) -> np.ndarray:
    """Draw a mask (855, 855) bool: outlines of one annotation are filled even-odd, annotations are united."""
    canvas = np.zeros((CANVAS_PX, CANVAS_PX), bool)
    side = CANVAS_PX * FINE
    for outlines in annotations:
        fine = np.zeros((side, side), bool)
        for outline in outlines:
            x, y = (outline * FINE - 0.5).T
            rows, columns = polygon(y, x, (side, side))
            fine[rows, columns] ^= True
        canvas |= fine.reshape(CANVAS_PX, FINE, CANVAS_PX, FINE).any(axis=(1, 3))
    return cv2.resize(canvas.view(np.uint8), (FULL_PX, FULL_PX), interpolation=cv2.INTER_NEAREST).view(bool)


def _box(annotation: Any, where: str) -> tuple[int, int, int, int]:
    box = annotation.get("target_box")
    if not isinstance(box, list) or len(box) != 4 or not all(isinstance(edge, int) for edge in box):
        raise SourceError(f"{where}/annotation.json, field 'target_box'", "[x0, y0, x1, y1] on the 855 x 855 image", repr(box),
                          "without it a crop cannot be cut from TORAS outlines; score the masks set")
    return box[0], box[1], box[2], box[3]
