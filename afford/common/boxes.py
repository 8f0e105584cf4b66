"""The box of a mask as slices of rows and columns: `image[box(mask)]` is cropped to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Box = tuple[slice, slice]
"""rows, columns; stops not included"""

BORDER = 50 / 855
"""border of ActAffordance's crops, as a share of the longer side of the image"""


def box(mask: np.ndarray, border_px: int | Sequence[int] = 0) -> Box:
    """The smallest box around the mask (h, w) bool, and a border inside the image: one width for all sides, or left, top, right,
    bottom. Empty slices for an empty mask.
    """
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return slice(0, 0), slice(0, 0)
    left, top, right, bottom = np.broadcast_to(border_px, 4).tolist()
    height, width = mask.shape
    return (slice(max(int(rows[0]) - top, 0), min(int(rows[-1]) + 1 + bottom, height)),
            slice(max(int(columns[0]) - left, 0), min(int(columns[-1]) + 1 + right, width)))
