"""Conversion between outlines, masks and COCO run lengths.

Outlines are drawn by VISOR's rule: corners are truncated, all outlines of an annotation are filled together (even-odd).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import cv2
import numpy as np

from schemas.video import Annotation, Polygon

FAR_PX = 2**14
"""corners are clamped to this coordinate, far outside any image, so that the fill stays in its number range"""


def rasterise(annotation: Annotation, width_px: int, height_px: int, out_width_px: int, out_height_px: int) -> np.ndarray:
    """Rasterise an annotation with a grid of width_px x height_px to a mask (out_height_px, out_width_px) bool.

    Drawing follows VISOR's own tools: int32 truncation, even-odd fill on the annotation grid, nearest-neighbour resize. Outlines
    are clipped to the grid. Source: VISOR paper, annotation format, and its visualisation code.
    """
    grid = fill(annotation.polygons, width_px, height_px)
    return cv2.resize(grid, (out_width_px, out_height_px), interpolation=cv2.INTER_NEAREST).astype(bool)


def fill(polygons: Iterable[Polygon], width_px: int, height_px: int) -> np.ndarray:
    """Fill outlines together on their own grid: (height_px, width_px) uint8, 1 inside."""
    grid = np.zeros((height_px, width_px), np.uint8)
    corners = [np.clip(polygon.points, -FAR_PX, FAR_PX).astype(np.int32) for polygon in polygons if len(polygon.points)]
    if corners:
        cv2.fillPoly(grid, corners, 1)
    return grid


def trace(mask: np.ndarray, at: tuple[int, int] = (0, 0)) -> tuple[Polygon, ...]:
    """Trace the outlines of a (h, w) mask; `fill` reproduces exactly this mask. Holes are outlines inside outlines.

    at: position x, y of the mask in its image, px.
    """
    if not mask.size:
        return ()
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE, offset=at)
    return tuple(Polygon(outline.reshape(-1, 2).astype(np.float32)) for outline in outlines)


def union(first: Iterable[Polygon], second: Iterable[Polygon], width_px: int, height_px: int) -> tuple[Polygon, ...]:
    """Compute the outlines of the union of two annotations; filled together, their overlap would cancel."""
    return trace(fill(first, width_px, height_px) | fill(second, width_px, height_px))


ZERO_CHARACTER = 48
"""character of 0"""
MOST_CHARACTERS = 12
"""characters of one number, 5 bits each; far beyond the pixels of an image"""


class BoxedMask(NamedTuple):
    """A mask cropped to its bounding box."""

    mask: np.ndarray
    """(h, w) bool"""
    x: int
    y: int
    """its upper left corner in the image, px"""


def run_lengths(counts: Any, height_px: int, width_px: int) -> np.ndarray:
    """Decode COCO counts to alternating run lengths (n,) int64 of 0 and 1, down the columns.

    ValueError for malformed counts, and for runs that do not fill the image.
    """
    if isinstance(counts, str):
        runs = _uncompressed(counts)
    elif isinstance(counts, list) and all(type(run) is int and 0 <= run <= height_px * width_px for run in counts):
        runs = np.array(counts, np.int64)
    else:
        raise ValueError("counts that are neither text nor whole numbers from 0 to the pixels of the image")
    if ((runs < 0) | (runs > height_px * width_px)).any() or int(runs.sum()) != height_px * width_px:
        raise ValueError(f"counts that do not sum up to {height_px * width_px}")
    return runs


def boxed_mask(runs: np.ndarray, height_px: int) -> BoxedMask:
    """Decode run lengths in an image of `height_px` rows to a mask cropped to its box; work and memory are those of the box."""
    stops = np.cumsum(runs)[1::2]
    starts = stops - runs[1::2]
    starts, stops = starts[stops > starts], stops[stops > starts]
    if not len(starts):
        return BoxedMask(np.zeros((0, 0), bool), 0, 0)
    left, right = int(starts[0]) // height_px, int(stops[-1] - 1) // height_px
    whole = bool((starts // height_px != (stops - 1) // height_px).any())
    top = 0 if whole else int((starts % height_px).min())
    rows = (height_px - 1 if whole else int(((stops - 1) % height_px).max())) - top + 1
    columns = right - left + 1
    inside = (starts // height_px - left) * rows + starts % height_px - top
    edges = np.stack([inside, inside + stops - starts], axis=1).ravel()
    return BoxedMask(_filled(np.diff(edges, prepend=0, append=rows * columns), rows, columns), left, top)


def _filled(runs: np.ndarray, height_px: int, width_px: int) -> np.ndarray:
    return np.repeat(np.arange(len(runs)) % 2 > 0, runs).reshape(width_px, height_px).T


def _uncompressed(text: str) -> np.ndarray:
    """Decode numbers of 5 bits a character, lowest first; from the fourth on, each is the difference to the one before the last."""
    bits = np.frombuffer(text.encode("utf-32-le", "surrogatepass"), "<u4").astype(np.int64) - ZERO_CHARACTER
    if ((bits < 0) | (bits >= 64)).any():
        raise ValueError("counts with an invalid character")
    ends = np.flatnonzero(bits & 32 == 0)
    lengths = np.diff(ends, prepend=-1)
    if not len(ends) or int(lengths.max()) > MOST_CHARACTERS:
        raise ValueError("counts without an end, or with a number beyond all images")
    starts = ends - lengths + 1
    places = np.arange(int(ends[-1]) + 1) - np.repeat(starts, lengths)
    numbers = np.add.reduceat((bits[:len(places)] & 31) << (5 * places), starts)
    numbers[bits[ends] & 16 > 0] -= (1 << (5 * lengths))[bits[ends] & 16 > 0]
    numbers[1::2] = np.cumsum(numbers[1::2])
    numbers[2::2] = np.cumsum(numbers[2::2])
    return numbers
