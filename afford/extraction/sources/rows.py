"""Annotations as a source has them, before hands and gloves are merged, and the checks that are common to all formats."""

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
"""corners this far outside the grid count as rounding"""


Note = tuple[int, str]
"""frame number of a remark, 0 for the whole video, and the remark: one sentence"""


@dataclass(frozen=True)
class RawAnnotation:
    """An annotation as read from the file; `worn` are the hands of a glove, as written."""

    annotation_id: str
    name: str
    class_id: int
    contact: str
    exhaustive: str
    worn: tuple[str, ...]
    polygons: tuple[Polygon, ...]


@dataclass(frozen=True)
class AnnotatedImage:
    """Annotations of one image; `where` is the file and the image, for messages."""

    where: str
    image: str
    frame: int
    width_px: int
    height_px: int
    rows: tuple[RawAnnotation, ...]


def unique_frames(images: Iterable[AnnotatedImage]) -> list[AnnotatedImage]:
    """Sort images by frame; SourceError when a frame occurs twice."""
    seen: dict[int, AnnotatedImage] = {}
    for annotated in images:
        if seen.setdefault(annotated.frame, annotated) is not annotated:
            raise SourceError(annotated.where, "one entry per frame", f"a second one for frame {annotated.frame}", "merge the two")
    return [seen[frame] for frame in sorted(seen)]


def grid_size(image: Any, where: str) -> tuple[int, int]:
    """Read the (width, height) of an image entry; SourceError for a size out of range."""
    size = json_field(image, "width", int, where), json_field(image, "height", int, where)
    if not 0 < min(size) <= max(size) <= FAR_PX or size[0] * size[1] > MAX_PIXELS:
        label = f"{where}, fields 'width' and 'height'"
        raise SourceError(label, f"1 to {FAR_PX} px each and {MAX_PIXELS / 1e6:g} megapixels at most", f"{size[0]} and {size[1]}",
                          "correct them")
    return size


def worn_on(value: Any, where: str) -> tuple[str, ...]:
    """Read the names of the hands that wear a glove; SourceError for other values."""
    names = [value] if isinstance(value, str) else value or []
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise SourceError(f"{where}, field 'on_which_hand'", "a list of hands", repr(value)[:60], "correct it")
    return tuple(names)


def outlines(segments: Any, where: str) -> tuple[Polygon, ...]:
    """Read polygons from [[x, y], ...] lists; empty ones are dropped. SourceError for anything but lists of number pairs."""
    if not isinstance(segments, list):
        raise SourceError(f"{where}, field 'segments'", "a list of polygons", type(segments).__name__, "correct the annotation")
    return tuple(Polygon(_corners(segment, where)) for segment in segments if segment)


def _corners(segment: Any, where: str) -> np.ndarray:
    """Read corners (n, 2) float32 that truncate to the same integers as the numbers in the file."""
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


def visible_rows(annotated: AnnotatedImage, notes: list[Note]) -> list[RawAnnotation]:
    """Select the annotations inside the image; dropped and clipped ones are reported in `notes`."""
    kept, grid = [], f"{annotated.width_px}x{annotated.height_px}"
    for row in annotated.rows:
        label = f"{annotated.where}: {row.name!r} ({row.annotation_id})"
        if not row.polygons:
            notes.append((annotated.frame, f"{label} has no outline and was left out"))
        elif not _inside_grid(row.polygons, annotated.width_px, annotated.height_px):
            notes.append((annotated.frame, f"{label} lies outside the {grid} grid and was left out"))
        else:
            kept.append(row)
            if _leaves_grid(row.polygons, annotated.width_px, annotated.height_px):
                notes.append((annotated.frame, f"{label} leaves the {grid} grid and was cut off at its border"))
    return kept


def _inside_grid(polygons: Sequence[Polygon], width_px: int, height_px: int) -> bool:
    size = np.array([width_px, height_px])
    return any(bool((p.points.max(axis=0) >= 0).all() and (p.points.min(axis=0) < size).all()) for p in polygons)


def _leaves_grid(polygons: Sequence[Polygon], width_px: int, height_px: int) -> bool:
    far = np.array([width_px, height_px]) + SLACK_PX
    return any(bool((p.points < -SLACK_PX).any() or (p.points > far).any()) for p in polygons)


BEYOND = 1.1
"""an outline that extends beyond this multiple of the grid refers to another grid"""
SMALL = 0.5
"""outlines that all stay within this share of the grid probably refer to a smaller grid"""


def check_grid_size(images: Sequence[AnnotatedImage], name: str, notes: list[Note]) -> None:
    """Check outlines against the grid: SourceError when most leave it, a remark when all are in its upper left quarter."""
    reach = np.array([
        np.max([p.points.max(axis=0) for p in row.polygons], axis=0) / (annotated.width_px, annotated.height_px)
        for annotated in images for row in annotated.rows if row.polygons]).reshape(-1, 2)
    if not len(reach):
        return
    grid = f"{images[0].width_px}x{images[0].height_px}"
    outside = int((reach > BEYOND).any(axis=1).sum())
    if outside > len(reach) / 2:
        raise SourceError(f"{name}, field 'segments'", f"outlines on a grid of {grid}", f"{outside} of {len(reach)} outside it",
                          "if they refer to another resolution, give each image its 'width' and 'height'")
    if (reach < SMALL).all():
        notes.append((0, f"{name}: all outlines lie in the upper left quarter of the {grid} grid; if they refer to another "
                         "resolution, give each image its 'width' and 'height'"))


def refuse_normalised(outlines: Sequence[np.ndarray], where: str) -> None:
    """Raise SourceError for normalised coordinates: all corners of a file between 0 and 1."""
    largest = max((float(np.abs(corners).max()) for corners in outlines if corners.size), default=np.inf)
    if largest <= 1:
        raise SourceError(where, "corners in pixels", f"normalised coordinates up to {largest:g}",
                          "multiply x by the width and y by the height of the image")
