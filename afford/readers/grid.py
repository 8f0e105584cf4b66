"""Do the outlines of a file fit the grid that they are said to refer to?"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from afford.readers.errors import SourceError
from afford.readers.rows import Note, Sheet

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
