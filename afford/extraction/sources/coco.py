"""Reader of COCO JSON (polygons, or plain or compressed run lengths) of an own video: annotated images."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from pycocotools import mask as coco_mask

from afford.common.bounded import box_px, check_drawn, outline_px
from afford.common.errors import SourceError
from afford.common.text import json_field
from afford.common.video.probe import LAST_FRAME
from afford.extraction.sources.outlines import FAR_PX, boxed_mask, run_lengths, trace
from afford.extraction.sources.rows import AnnotatedImage, RawAnnotation, grid_size, refuse_normalised, unique_frames, worn_on
from afford.extraction.sources.visor import frame_number
from schemas.video import Polygon


def read_images(document: Any, name: str) -> list[AnnotatedImage]:
    """Read the annotated images of a file called `name`, by frame number.

    The field `frame` of an image is its frame number, or else the number at the end of `file_name`. Numbers start at 1, unless
    `info.first_frame` is 0. SourceError when a field is missing, has another type, or refers to an unknown id.
    """
    names = {json_field(c, "id", int, f"{name}, categories"): json_field(c, "name", str, f"{name}, categories")
             for c in json_field(document, "categories", list, name)}
    images = json_field(document, "images", list, name)
    raws: dict[Any, list[Any]] = {json_field(image, "id", int, f"{name}, images"): [] for image in images}
    if len(raws) < len(images):
        raise SourceError(f"{name}, images", "ids that differ", f"{len(images)} images of {len(raws)} ids", "give each its own id")
    for raw in json_field(document, "annotations", list, name):
        where = f"{name}, annotation {json_field(raw, 'id', int, f'{name}, annotations')}"
        if json_field(raw, "image_id", int, where) not in raws:
            raise SourceError(f"{where}, field 'image_id'", "the id of an image", str(raw["image_id"]), "correct it")
        raws[raw["image_id"]].append(raw)
    _check_pixels(document, name)
    check_drawn((_drawn_px(raw, image, name) for image in images for raw in raws[image["id"]]), name)
    offset = 1 - _first_frame(document.get("info"))
    found = [_annotated_image(image, raws[image["id"]], names, name, offset) for image in images]
    return unique_frames(annotated for annotated in found if annotated.rows)


def _first_frame(info: Any) -> int:
    return 0 if isinstance(info, dict) and info.get("first_frame") == 0 else 1


def _annotated_image(image: Any, raws: list[Any], names: Mapping[int, str], name: str, offset: int) -> AnnotatedImage:
    where = f"{name}, image {image['id']}"
    file_name = str(image.get("file_name", ""))
    number = json_field(image, "frame", int, where) if "frame" in image else frame_number(file_name, f"{where}, field 'file_name'")
    if not 1 <= number + offset <= LAST_FRAME:
        raise SourceError(where, "frame numbers from 1 on", str(number), 'if they start at 0, add "info": {"first_frame": 0}')
    width_px, height_px = grid_size(image, where)
    rows = tuple(_raw_annotation(raw, names, f"{name}, annotation {raw.get('id')}", (height_px, width_px)) for raw in raws)
    return AnnotatedImage(where, file_name, number + offset, width_px, height_px, rows)


def _raw_annotation(raw: Any, names: Mapping[int, str], where: str, size_hw: tuple[int, int]) -> RawAnnotation:
    category = json_field(raw, "category_id", int, where)
    if category not in names:
        raise SourceError(f"{where}, field 'category_id'", "the id of a category", str(category), "correct it")
    more = raw["attributes"] if isinstance(raw.get("attributes"), dict) else {}
    contact = raw.get("in_contact_object", more.get("in_contact_object"))
    return RawAnnotation(
        annotation_id=str(json_field(raw, "id", int, where)), name=names[category], class_id=-1,
        contact="" if contact is None else str(contact), exhaustive="inconclusive",
        worn=worn_on(raw.get("on_which_hand", more.get("on_which_hand")), where),
        polygons=_outlines(raw.get("segmentation"), where, size_hw))


def _drawn_px(raw: Any, image: Any, name: str) -> int:
    """Cost of drawing an annotation: the pixels of the bounding box of its mask, and the length of its outlines."""
    segmentation, label = raw.get("segmentation"), f"{name}, annotation {raw['id']}, field 'segmentation'"
    width_px, height_px = grid_size(image, f"{name}, image {image['id']}")
    if not segmentation:
        return 0
    if not isinstance(segmentation, list):
        return _strip_px(_runs(segmentation, label, (height_px, width_px)), height_px)
    corners = [polygon.reshape(-1, 2) for polygon in _flat(segmentation, label)]
    lengths = sum(outline_px(polygon, label) for polygon in corners)
    return lengths + (box_px(np.concatenate(corners), width_px, height_px) if corners else 0)


def _check_pixels(document: Any, name: str) -> None:
    polygons = [polygon for raw in document["annotations"] if isinstance(raw.get("segmentation"), list)
                for polygon in _flat(raw["segmentation"], f"{name}, annotation {raw['id']}, field 'segmentation'")]
    refuse_normalised(polygons, f"{name}, field 'segmentation'")


def _strip_px(runs: np.ndarray, height_px: int) -> int:
    """Pixels in the columns from the first to the last of a mask."""
    first, last = int(runs[0]), int(runs.sum()) - (int(runs[-1]) if len(runs) % 2 else 0) - 1
    return max(last // height_px - first // height_px + 1, 0) * height_px


def _outlines(segmentation: Any, where: str, size_hw: tuple[int, int]) -> tuple[Polygon, ...]:
    """Convert a COCO segmentation to outlines: the union of its polygons, or its run lengths."""
    label = f"{where}, field 'segmentation'"
    if not segmentation:
        return ()
    if isinstance(segmentation, list):
        polygons = [polygon.tolist() for polygon in _flat(segmentation, label)]
        if not polygons:
            return ()
        united = coco_mask.merge(coco_mask.frPyObjects(polygons, *size_hw))
        found = boxed_mask(run_lengths(united["counts"].decode("ascii"), *size_hw), size_hw[0])
    else:
        found = boxed_mask(_runs(segmentation, label, size_hw), size_hw[0])
    return trace(found.mask, (found.x, found.y))


def _runs(segmentation: Any, label: str, size_hw: tuple[int, int]) -> np.ndarray:
    """Read run lengths (n,) int64; SourceError when they do not fill the image."""
    size = json_field(segmentation, "size", list, label)
    if tuple(size) != size_hw:
        raise SourceError(f"{label}, 'size'", f"the image's (h, w) {size_hw}", f"{size}", "correct it or the image's size")
    try:
        return run_lengths(segmentation.get("counts"), *size_hw)
    except ValueError as error:
        raise SourceError(label, "run lengths that fill the image", str(error), "export the masks again") from error


def _flat(segmentation: list[Any], label: str) -> list[np.ndarray]:
    """Read polygons as flat arrays of x, y; corners far outside the image are clamped."""
    try:
        flat = [np.asarray(polygon, np.float64) for polygon in segmentation if polygon]
    except (TypeError, ValueError, OverflowError):
        flat = [np.zeros(0)]
    if any(p.ndim != 1 or len(p) < 6 or len(p) % 2 or not np.isfinite(p).all() for p in flat):
        raise SourceError(label, "polygons as flat lists [x, y, x, y, x, y, ...]", repr(segmentation)[:60], "correct it")
    return [np.clip(polygon, -FAR_PX, FAR_PX) for polygon in flat]
