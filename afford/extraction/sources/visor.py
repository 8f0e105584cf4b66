"""VISOR JSON, sparse ground truth or dense interpolations -> sheets of annotations. VISOR, annotation format."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from afford.common.bounded import check_drawn
from afford.common.errors import SourceError
from afford.common.text import json_field
from afford.common.video.probe import parse_frame_number
from afford.extraction.sources.grid import refuse_normalised
from afford.extraction.sources.mapping import released
from afford.extraction.sources.rows import Row, Sheet, grid_size, once, outlines, worn_on

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
