"""One mask of one key frame as the source has it, before hands and gloves are sorted out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from afford.common.bounded import MAX_PIXELS, outline_px
from afford.common.errors import SourceError
from afford.common.text import json_field
from afford.extraction.sources.outlines import FAR_PX
from schemas.video import Polygon

SLACK_PX = 1.0
"""corners this far outside the grid are rounding, not worth a word"""


Note = tuple[int, str]
"""the frame that a remark is about, 0 for the whole video, and the remark: one sentence"""


@dataclass(frozen=True)
class Row:
    """An annotation as read; `worn` are the hands that a glove is on, as written."""

    annotation_id: str
    name: str
    class_id: int
    contact: str
    exhaustive: str
    worn: tuple[str, ...]
    polygons: tuple[Polygon, ...]


@dataclass(frozen=True)
class Sheet:
    """All annotations of one image; `where` names file and image in messages."""

    where: str
    image: str
    frame: int
    width_px: int
    height_px: int
    rows: tuple[Row, ...]


def once(sheets: Iterable[Sheet]) -> list[Sheet]:
    """Sheets by frame; SourceError when a frame is there twice."""
    seen: dict[int, Sheet] = {}
    for sheet in sheets:
        if seen.setdefault(sheet.frame, sheet) is not sheet:
            raise SourceError(sheet.where, "one entry per frame", f"a second one for frame {sheet.frame}", "merge the two")
    return [seen[frame] for frame in sorted(seen)]


def grid_size(image: Any, where: str) -> tuple[int, int]:
    """(width, height) that an image entry states; SourceError when they are no sensible size."""
    size = json_field(image, "width", int, where), json_field(image, "height", int, where)
    if not 0 < min(size) <= max(size) <= FAR_PX or size[0] * size[1] > MAX_PIXELS:
        label = f"{where}, fields 'width' and 'height'"
        raise SourceError(label, f"1 to {FAR_PX} px each and {MAX_PIXELS / 1e6:g} megapixels at most", f"{size[0]} and {size[1]}",
                          "correct them")
    return size


def worn_on(said: Any, where: str) -> tuple[str, ...]:
    """Names of the hands that a glove is on; SourceError when they are not names."""
    names = [said] if isinstance(said, str) else said or []
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise SourceError(f"{where}, field 'on_which_hand'", "a list of hands", repr(said)[:60], "correct it")
    return tuple(names)


def outlines(segments: Any, where: str) -> tuple[Polygon, ...]:
    """Polygons of [[x, y], ...] lists; empty ones are left out. SourceError when one is not a list of number pairs."""
    if not isinstance(segments, list):
        raise SourceError(f"{where}, field 'segments'", "a list of polygons", type(segments).__name__, "correct the annotation")
    return tuple(Polygon(_corners(segment, where)) for segment in segments if segment)


def _corners(segment: Any, where: str) -> np.ndarray:
    """(n, 2) float32 corners that truncate to the same integers as the numbers in the file."""
    try:
        exact = np.asarray(segment, np.float64)
    except (TypeError, ValueError, OverflowError):
        exact = np.zeros(0)
    if exact.ndim != 2 or exact.shape[1] != 2 or not np.isfinite(exact).all():
        raise SourceError(f"{where}, field 'segments'", "polygons as lists of [x, y] numbers", repr(segment)[:60],
                          "correct the annotation")
    exact = np.clip(exact, -FAR_PX, FAR_PX)
    outline_px(exact, f"{where}, field 'segments'")
    single = exact.astype(np.float32)
    return np.where(single.astype(np.int32) == exact.astype(np.int32), single, np.trunc(exact)).astype(np.float32)


def visible(sheet: Sheet, notes: list[Note]) -> list[Row]:
    """The rows of which something lies in the image; `notes` says what was left out or cut off."""
    kept, grid = [], f"{sheet.width_px}x{sheet.height_px}"
    for row in sheet.rows:
        label = f"{sheet.where}: {row.name!r} ({row.annotation_id})"
        if not row.polygons:
            notes.append((sheet.frame, f"{label} has no outline and was left out"))
        elif not _touches(row.polygons, sheet.width_px, sheet.height_px):
            notes.append((sheet.frame, f"{label} lies outside the {grid} grid and was left out"))
        else:
            kept.append(row)
            if _sticks_out(row.polygons, sheet.width_px, sheet.height_px):
                notes.append((sheet.frame, f"{label} leaves the {grid} grid and was cut off at its border"))
    return kept


def _touches(polygons: Sequence[Polygon], width_px: int, height_px: int) -> bool:
    size = np.array([width_px, height_px])
    return any(bool((p.points.max(axis=0) >= 0).all() and (p.points.min(axis=0) < size).all()) for p in polygons)


def _sticks_out(polygons: Sequence[Polygon], width_px: int, height_px: int) -> bool:
    far = np.array([width_px, height_px]) + SLACK_PX
    return any(bool((p.points < -SLACK_PX).any() or (p.points > far).any()) for p in polygons)


BEYOND = 1.1
"""an outline that reaches beyond this many grids is not just drawn over the border"""
SMALL = 0.5
"""outlines that all stay within this part of the grid were probably drawn on a smaller one"""


def check_grid(sheets: Sequence[Sheet], name: str, notes: list[Note]) -> None:
    """SourceError when most outlines of a file leave the grid; a remark when all of them lie in one corner of it."""
    reach = np.array([
        np.max([p.points.max(axis=0) for p in row.polygons], axis=0) / (sheet.width_px, sheet.height_px)
        for sheet in sheets for row in sheet.rows if row.polygons]).reshape(-1, 2)
    if not len(reach):
        return
    grid = f"{sheets[0].width_px}x{sheets[0].height_px}"
    outside = int((reach > BEYOND).any(axis=1).sum())
    if outside > len(reach) / 2:
        raise SourceError(f"{name}, field 'segments'", f"outlines on a grid of {grid}", f"{outside} of {len(reach)} outside it",
                          "if they refer to another resolution, give each image its 'width' and 'height'")
    if (reach < SMALL).all():
        notes.append((0, f"{name}: all outlines lie in the upper left quarter of the {grid} grid; if they refer to another "
                         "resolution, give each image its 'width' and 'height'"))


def refuse_normalised(outlines: Sequence[np.ndarray], where: str) -> None:
    """SourceError when all corners of a file lie between 0 and 1: they are shares of the picture, not pixels."""
    largest = max((float(np.abs(corners).max()) for corners in outlines if corners.size), default=np.inf)
    if largest <= 1:
        raise SourceError(where, "corners in pixels", f"none above {largest:g}: normalised coordinates",
                          "multiply x by the width and y by the height of the image")
