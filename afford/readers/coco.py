"""COCO JSON (polygons, or run lengths plain or compressed) of one's own video -> sheets of annotations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pycocotools import mask as coco_mask

from afford.readers.errors import SourceError
from afford.readers.polygons import trace
from afford.readers.rows import Row, Sheet
from afford.readers.strict_json import entry
from afford.readers.visor import frame_number
from schemas.clip import Polygon


def sheets(document: Any, name: str) -> list[Sheet]:
    """The annotated images of a file called `name`, by frame number.

    An image is tied to its frame by its field `frame`, or else by the number at the end of `file_name`; numbers start at 1,
    unless `info.first_frame` says 0. SourceError when a field is missing, of another kind, or names something unknown.
    """
    names = {entry(c, "id", int, f"{name}, categories"): entry(c, "name", str, f"{name}, categories")
             for c in entry(document, "categories", list, name)}
    images = entry(document, "images", list, name)
    raws: dict[Any, list[Any]] = {entry(image, "id", int, f"{name}, images"): [] for image in images}
    for raw in entry(document, "annotations", list, name):
        where = f"{name}, annotation {raw.get('id')}"
        if raw.get("image_id") not in raws:
            raise SourceError(f"{where}, field 'image_id'", "the id of an image", repr(raw.get("image_id")), "correct it")
        raws[raw["image_id"]].append(raw)
    offset = 1 - int((document.get("info") or {}).get("first_frame", 1))
    found = [_sheet(image, raws[image["id"]], names, name, offset) for image in images]
    return sorted((sheet for sheet in found if sheet.rows), key=lambda sheet: sheet.frame)


def _sheet(image: Any, raws: list[Any], names: Mapping[int, str], name: str, offset: int) -> Sheet:
    where = f"{name}, image {image['id']}"
    file_name = str(image.get("file_name", ""))
    number = int(image["frame"]) if "frame" in image else frame_number(file_name, f"{where}, field 'file_name'")
    if number + offset < 1:
        raise SourceError(where, "frame numbers from 1 on", str(number), 'if they start at 0, add "info": {"first_frame": 0}')
    width_px, height_px = entry(image, "width", int, where), entry(image, "height", int, where)
    rows = tuple(_row(raw, names, f"{name}, annotation {raw.get('id')}", (height_px, width_px)) for raw in raws)
    return Sheet(where, file_name, number + offset, width_px, height_px, rows)


def _row(raw: Any, names: Mapping[int, str], where: str, size_hw: tuple[int, int]) -> Row:
    category = entry(raw, "category_id", int, where)
    if category not in names:
        raise SourceError(f"{where}, field 'category_id'", "the id of a category", str(category), "correct it")
    more = raw.get("attributes") or {}
    contact = raw.get("in_contact_object", more.get("in_contact_object"))
    return Row(
        annotation_id=str(entry(raw, "id", int, where)), name=names[category], class_id=-1,
        contact="" if contact is None else str(contact), exhaustive="inconclusive",
        worn=tuple(raw.get("on_which_hand", more.get("on_which_hand")) or ()),
        polygons=_outlines(raw.get("segmentation"), where, size_hw))


def _outlines(segmentation: Any, where: str, size_hw: tuple[int, int]) -> tuple[Polygon, ...]:
    """Outlines that give the mask as COCO draws it: the union of its polygons, or its run lengths."""
    if not segmentation:
        return ()
    try:
        codes = coco_mask.frPyObjects(segmentation, *size_hw) if _must_encode(segmentation) else segmentation
        mask = coco_mask.decode(coco_mask.merge(codes) if isinstance(codes, list) else codes)
    except (TypeError, ValueError, KeyError, AttributeError) as error:
        raise SourceError(f"{where}, field 'segmentation'", "COCO polygons or run lengths", str(error), "correct it") from error
    if mask.shape != size_hw:
        raise SourceError(f"{where}, field 'segmentation'", f"the image's size (h, w) {size_hw}", f"{mask.shape}",
                          "correct 'size' or the image's 'width' and 'height'")
    return trace(np.asarray(mask, bool))


def _must_encode(segmentation: Any) -> bool:
    return isinstance(segmentation, list) or isinstance(segmentation["counts"], list)
