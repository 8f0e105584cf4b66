"""Checks that the outlines of a file fit the grid that they refer to, and the grid the video."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from afford.common.errors import SourceError
from afford.extraction.sources.rows import Note, Sheet

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
