"""Outlines <-> masks by VISOR's rule: corners truncated, the outlines of an annotation filled together (even-odd)."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from schemas.video import Annotation, Polygon

FAR_PX = 2**14
"""corners beyond this lie far outside any image; they are pulled in to it, so that the fill stays in its number range"""


def rasterise(annotation: Annotation, width_px: int, height_px: int, out_width_px: int, out_height_px: int) -> np.ndarray:
    """Mask (out_height_px, out_width_px) bool of an annotation whose grid is width_px x height_px.

    As VISOR's own tools draw it: int32 truncation, even-odd fill on the annotation grid, nearest-neighbour resize. What lies
    outside the grid is cut off. VISOR paper, annotation format; reading corners as in its visualisation code.
    """
    grid = fill(annotation.polygons, width_px, height_px)
    return cv2.resize(grid, (out_width_px, out_height_px), interpolation=cv2.INTER_NEAREST).astype(bool)


def fill(polygons: Iterable[Polygon], width_px: int, height_px: int) -> np.ndarray:
    """Draw outlines together on their own grid: (height_px, width_px) uint8, 1 inside."""
    grid = np.zeros((height_px, width_px), np.uint8)
    corners = [np.clip(polygon.points, -FAR_PX, FAR_PX).astype(np.int32) for polygon in polygons if len(polygon.points)]
    if corners:
        cv2.fillPoly(grid, corners, 1)
    return grid


def trace(mask: np.ndarray, at: tuple[int, int] = (0, 0)) -> tuple[Polygon, ...]:
    """Outlines of a (h, w) mask that `fill` turns into exactly this mask again; holes are outlines inside outlines. `at`: x, y of
    the mask in its image, px.
    """
    if not mask.size:
        return ()
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE, offset=at)
    return tuple(Polygon(outline.reshape(-1, 2).astype(np.float32)) for outline in outlines)


def union(first: Iterable[Polygon], second: Iterable[Polygon], width_px: int, height_px: int) -> tuple[Polygon, ...]:
    """Outlines of the union of two annotations (drawn together, their overlap would cancel)."""
    return trace(fill(first, width_px, height_px) | fill(second, width_px, height_px))
