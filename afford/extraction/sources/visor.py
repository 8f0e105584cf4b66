"""VISOR JSON, sparse ground truth or dense interpolations -> sheets of annotations. VISOR, annotation format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any

from afford.common.bounded import check_drawn
from afford.common.errors import SourceError
from afford.common.text import json_field, parse_json, word_tables
from afford.common.video.probe import epic_rate, parse_frame_number
from afford.extraction.sources.discover import DENSE, FRAME_MAPPING, SPARSE
from afford.extraction.sources.rows import Row, Sheet, grid_size, once, outlines, refuse_normalised, worn_on
from schemas.files import FileTree

RELEASED = "frame_"
"""how EPIC's own frames are called; VISOR's begin with the video's id"""


def read_mapping(files: FileTree, frames: Sequence[str]) -> Mapping[str, str]:
    """VISOR's image names -> those of EPIC's released frames, empty where `frames` (names of the media) are others.

    SourceError when the table is needed and missing, malformed, or silent about the video.
    """
    if not any(PurePosixPath(name).name.startswith(RELEASED) for name in frames):
        return {}
    table, needed = files.find(FRAME_MAPPING), epic_rate(files.name) is not None and _by_visor(files)
    if table is None and not needed:
        return {}
    if table is None:
        raise SourceError(FRAME_MAPPING, f"VISOR's table of frame numbers, because {frames[0]} is one of EPIC's released frames, "
                          "which are numbered otherwise", "nothing", "put it beside the tables (`python pipeline.py fetch-list` "
                          "says where it is), or use the video itself")
    found = word_tables(parse_json(table.path.read_bytes(), FRAME_MAPPING), FRAME_MAPPING)
    if needed and files.name not in found:
        raise SourceError(FRAME_MAPPING, f"an entry for {files.name}", f"{len(found)} other videos", "get the file again")
    return found.get(files.name, {})


def released(image: Mapping[str, Any], name: str, mapped: Mapping[str, str]) -> int | None:
    """The released frame that an image of VISOR shows; None when the table does not say. A dense image is as far from its place
    as the sparse ones between which it was interpolated.
    """
    if name in mapped:
        return parse_frame_number(mapped[name])
    ends = [str(image.get(f"interpolation_{end}_frame", "")).replace(".png", ".jpg") for end in ("start", "end")]
    shifts = {_shift(end, mapped[end]) for end in ends if end in mapped}
    number = parse_frame_number(name)
    return number + shifts.pop() if number is not None and len(shifts) == 1 and set(ends) <= mapped.keys() else None


def _shift(ours: str, theirs: str) -> int:
    return (parse_frame_number(theirs) or 0) - (parse_frame_number(ours) or 0)


def _by_visor(files: FileTree) -> bool:
    return any(file.name.startswith((SPARSE, DENSE)) for file in files.files)


SPARSE_GRID_WH = (1920, 1080)
DENSE_GRID_WH = (854, 480)
Mapped = Mapping[str, str]
"""image name of VISOR -> image name of the frames in use (frame_mapping.json); empty when they are VISOR's own"""
NOWHERE = 0
"""frame of an image of which the mapping does not say where it is"""


def sheets(document: Any, name: str, grid_wh: tuple[int, int], mapped: Mapped) -> list[Sheet]:
    """The annotated images of a file called `name`, by frame number.

    `grid_wh` is the size that coordinates refer to, unless an image states its own `width` and `height`. SourceError when a
    field is missing or of another kind, or a frame is there twice.
    """
    points = json_field(document, "video_annotations", list, name)
    found = [_sheet(point, f"{name}, image {number}", grid_wh, mapped) for number, point in enumerate(points, start=1)]
    refuse_normalised([p.points for sheet in found for row in sheet.rows for p in row.polygons], f"{name}, field 'segments'")
    check_drawn((_drawn_px(sheet) for sheet in found), name)
    return [sheet for sheet in found if sheet.frame == NOWHERE] + once(sheet for sheet in found if sheet.frame != NOWHERE)


def _drawn_px(sheet: Sheet) -> int:
    """What drawing an image takes: only gloves are drawn, to be joined with their hand, on the whole grid."""
    return sheet.width_px * sheet.height_px * sum(bool(row.worn) for row in sheet.rows)


def frame_number(image: str, where: str) -> int:
    """The frame that an image of this name shows; SourceError when the name does not say."""
    number = parse_frame_number(image)
    if number is None:
        raise SourceError(where, "a name that ends in the frame number", repr(image), "rename it, e.g. frame_0000000001.jpg")
    return number


def _sheet(point: Any, where: str, grid_wh: tuple[int, int], mapped: Mapped) -> Sheet:
    image = json_field(point, "image", dict, where)
    name = json_field(image, "name", str, where)
    label = f"{where} ({name})"
    width_px, height_px = grid_size(image, label) if {"width", "height"} & image.keys() else grid_wh
    raws = json_field(point, "annotations", list, label)
    rows = tuple(_row(raw, f"{label}, annotation {i}") for i, raw in enumerate(raws, start=1))
    number = (released(image, name, mapped) or NOWHERE) if mapped else frame_number(name, label)
    return Sheet(label, name, number, width_px, height_px, rows)


def _row(raw: Any, where: str) -> Row:
    name = json_field(raw, "name", str, where)
    return Row(
        annotation_id=str(raw.get("id") or f"{name} at {where}"),
        name=name,
        class_id=json_field(raw, "class_id", int, where) if raw.get("class_id") is not None else -1,
        contact=str(raw.get("in_contact_object") or ""),
        exhaustive=str(raw.get("exhaustive") or "inconclusive"),
        worn=worn_on(raw.get("on_which_hand"), where),
        polygons=outlines(json_field(raw, "segments", list, where), where),
    )
