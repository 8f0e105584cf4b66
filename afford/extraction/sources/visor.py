"""Reader of VISOR JSON, sparse ground truth or dense interpolations: annotated images, and the mapping of frame numbers.

VISOR numbers frames by the video, EPIC-KITCHENS-55 released its frames under other numbers; `frame_mapping.json` relates the two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePosixPath
from typing import Any

from afford.common.bounded import check_drawn
from afford.common.errors import SourceError
from afford.common.text import json_field, parse_json, word_tables
from afford.common.video.probe import epic_rate, parse_frame_number
from afford.extraction.sources.discover import DENSE, FRAME_MAPPING, SPARSE
from afford.extraction.sources.rows import (
    AnnotatedImage,
    RawAnnotation,
    grid_size,
    outlines,
    refuse_normalised,
    unique_frames,
    worn_on,
)
from schemas.files import FileTree

RELEASED = "frame_"
"""prefix of the names of EPIC's released frames; names of VISOR begin with the video id"""


def read_mapping(files: FileTree, frames: Sequence[str]) -> Mapping[str, str]:
    """Read the mapping from VISOR's image names to those of EPIC's released frames; empty for other `frames` (names of the media).

    SourceError when the table is needed and missing, malformed, or has no entry for the video.
    """
    if not any(PurePosixPath(name).name.startswith(RELEASED) for name in frames):
        return {}
    table, needed = files.find(FRAME_MAPPING), epic_rate(files.name) is not None and _has_visor_files(files)
    if table is None and not needed:
        return {}
    if table is None:
        raise SourceError(FRAME_MAPPING, f"VISOR's table of frame numbers, because {frames[0]} is one of EPIC's released frames, "
                          "which have other numbers", "no such file", "put it next to the tables (`python pipeline.py fetch-list` "
                          "lists its address), or use the video itself")
    found = word_tables(parse_json(table.path.read_bytes(), FRAME_MAPPING), FRAME_MAPPING)
    if needed and files.name not in found:
        raise SourceError(FRAME_MAPPING, f"an entry for {files.name}", f"{len(found)} other videos", "get the file again")
    return found.get(files.name, {})


def released_frame(image: Mapping[str, Any], name: str, mapped: Mapping[str, str]) -> int | None:
    """Map an image of VISOR to the number of a released frame; None when the table has no entry.

    A dense image has the offset of the sparse images between which it was interpolated.
    """
    if name in mapped:
        return parse_frame_number(mapped[name])
    ends = [str(image.get(f"interpolation_{end}_frame", "")).replace(".png", ".jpg") for end in ("start", "end")]
    shifts = {_shift(end, mapped[end]) for end in ends if end in mapped}
    number = parse_frame_number(name)
    return number + shifts.pop() if number is not None and len(shifts) == 1 and set(ends) <= mapped.keys() else None


def _shift(ours: str, theirs: str) -> int:
    return (parse_frame_number(theirs) or 0) - (parse_frame_number(ours) or 0)


def _has_visor_files(files: FileTree) -> bool:
    return any(file.name.startswith((SPARSE, DENSE)) for file in files.files)


SPARSE_GRID_WH = (1920, 1080)
DENSE_GRID_WH = (854, 480)
Mapped = Mapping[str, str]
"""image name of VISOR -> image name of the frames in use (frame_mapping.json); empty when they are VISOR's own"""
UNMAPPED = 0
"""frame number of an image without an entry in the mapping"""


def read_images(document: Any, name: str, grid_wh: tuple[int, int], mapped: Mapped) -> list[AnnotatedImage]:
    """Read the annotated images of a file called `name`, by frame number.

    `grid_wh` is the size that coordinates refer to, unless an image has its own `width` and `height`. SourceError when a field is
    missing or has another type, or a frame occurs twice.
    """
    points = json_field(document, "video_annotations", list, name)
    found = [_annotated_image(point, f"{name}, image {number}", grid_wh, mapped) for number, point in enumerate(points, start=1)]
    polygons = [polygon for annotated in found for row in annotated.rows for polygon in row.polygons]
    refuse_normalised([polygon.points for polygon in polygons], f"{name}, field 'segments'")
    check_drawn((_drawn_px(annotated) for annotated in found), name)
    unmapped = [annotated for annotated in found if annotated.frame == UNMAPPED]
    return unmapped + unique_frames(annotated for annotated in found if annotated.frame != UNMAPPED)


def _drawn_px(annotated: AnnotatedImage) -> int:
    """Cost of drawing an image: only gloves are drawn, on the whole grid, to merge them with their hand."""
    return annotated.width_px * annotated.height_px * sum(bool(row.worn) for row in annotated.rows)


def frame_number(image: str, where: str) -> int:
    """Parse the frame number of an image name; SourceError for a name without a number."""
    number = parse_frame_number(image)
    if number is None:
        raise SourceError(where, "a name that ends in the frame number", repr(image), "rename it, e.g. frame_0000000001.jpg")
    return number


def _annotated_image(point: Any, where: str, grid_wh: tuple[int, int], mapped: Mapped) -> AnnotatedImage:
    image = json_field(point, "image", dict, where)
    name = json_field(image, "name", str, where)
    label = f"{where} ({name})"
    width_px, height_px = grid_size(image, label) if {"width", "height"} & image.keys() else grid_wh
    raws = json_field(point, "annotations", list, label)
    rows = tuple(_raw_annotation(raw, f"{label}, annotation {i}") for i, raw in enumerate(raws, start=1))
    number = (released_frame(image, name, mapped) or UNMAPPED) if mapped else frame_number(name, label)
    return AnnotatedImage(label, name, number, width_px, height_px, rows)


def _raw_annotation(raw: Any, where: str) -> RawAnnotation:
    name = json_field(raw, "name", str, where)
    return RawAnnotation(
        annotation_id=str(raw.get("id") or f"{name} at {where}"),
        name=name,
        class_id=json_field(raw, "class_id", int, where) if raw.get("class_id") is not None else -1,
        contact=str(raw.get("in_contact_object") or ""),
        exhaustive=str(raw.get("exhaustive") or "inconclusive"),
        worn=worn_on(raw.get("on_which_hand"), where),
        polygons=outlines(json_field(raw, "segments", list, where), where),
    )
