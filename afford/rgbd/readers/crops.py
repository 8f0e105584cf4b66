"""The middle of a picture, as the paper cuts it out of UMD and IIT-AFF."""

from __future__ import annotations

import numpy as np

from afford.common.errors import SourceError


def centre(where: str, size_px: int, *arrays: np.ndarray) -> tuple[list[np.ndarray], tuple[int, int]]:
    """The middle `size_px` x `size_px` of arrays (h, w, ...) of one size, and how many columns and rows were cut off at the left
    and at the top; 0 for whole pictures. Of a picture that is smaller, the largest square: nothing is enlarged. SourceError when
    they differ in size.
    """
    height, width = arrays[0].shape[:2]
    for array in arrays:
        if array.shape[:2] != (height, width):
            raise SourceError(where, f"depth and label of {width} x {height} px like the picture",
                              f"{array.shape[1]} x {array.shape[0]}", "were they resized?")  # fmt: skip
    if not size_px:
        return list(arrays), (0, 0)
    side = min(size_px, height, width)
    left, top = (width - side) // 2, (height - side) // 2
    return [np.ascontiguousarray(a[top : top + side, left : left + side]) for a in arrays], (left, top)


def mapped(label: np.ndarray, table: np.ndarray, where: str) -> np.ndarray:
    """(h, w) uint8 of our classes, from those of a source by `table` (n,); SourceError for a class that the table does not have."""
    if label.size and (label.min() < 0 or label.max() >= len(table)):
        got = f"{int(label.min())} to {int(label.max())}"
        raise SourceError(where, f"labels 0 to {len(table) - 1}", got, "is it the label file?")
    return np.asarray(table[label.astype(np.intp)])
