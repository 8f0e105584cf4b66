"""Bounds on what drawing the masks of a file takes, from the numbers in the file alone."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from afford.common.errors import SourceError

MOST_OUTLINE_PX = 2**21
"""length of one outline: a hand at 4K has some thousand pixels"""
MOST_DRAWN_PX = 2**36
"""boxes around all masks of one file: 8,000 pictures of 8 megapixels, each full of masks"""


def outline_px(corners: np.ndarray, where: str) -> int:
    """Length of the closed outline of (n, 2) corners, px; SourceError for one that no mask has."""
    length = int(np.abs(np.diff(corners, axis=0, append=corners[:1])).max(axis=1).sum()) if len(corners) else 0
    if length > MOST_OUTLINE_PX:
        raise SourceError(where, f"an outline of at most {MOST_OUTLINE_PX} px", f"one of {length}", "draw it again")
    return length


def box_px(corners: np.ndarray, width_px: int, height_px: int) -> int:
    """Area of the box around (n, 2) corners inside a picture."""
    if not len(corners):
        return 0
    size = np.clip(corners.max(axis=0), 0, (width_px, height_px)) - np.clip(corners.min(axis=0), 0, (width_px, height_px)) + 1
    return int(size[0]) * int(size[1])


def check_drawn(areas: Iterable[int], name: str) -> None:
    """SourceError when the masks of the file called `name` cover more than `MOST_DRAWN_PX` together."""
    total = sum(areas)
    if total > MOST_DRAWN_PX:
        raise SourceError(name, f"masks of at most {MOST_DRAWN_PX / 1e9:.0f} gigapixels together", f"{total / 1e9:.0f}",
                          "annotate fewer frames, or smaller pictures")
