"""The middle of a picture, as the paper cuts it out of UMD and IIT-AFF."""

from __future__ import annotations

import numpy as np

from afford.readers.errors import SourceError


def centre(where: str, size_px: int, *arrays: np.ndarray) -> tuple[list[np.ndarray], tuple[int, int]]:
    """The middle `size_px` x `size_px` of arrays (h, w, ...) of one size, and how many columns and rows were cut off at the left
    and at the top; 0 for whole pictures. SourceError when they differ in size or are smaller."""
    height, width = arrays[0].shape[:2]
    for array in arrays:
        if array.shape[:2] != (height, width):
            raise SourceError(where, f"depth and label of {width} x {height} px like the picture",
                              f"{array.shape[1]} x {array.shape[0]}", "were they resized?")  # fmt: skip
    if not size_px:
        return list(arrays), (0, 0)
    if min(height, width) < size_px:
        raise SourceError(where, f"{size_px} px each way at least", f"{width} x {height}", "set static_read.crop_px smaller")
    left, top = (width - size_px) // 2, (height - size_px) // 2
    return [np.ascontiguousarray(a[top : top + size_px, left : left + size_px]) for a in arrays], (left, top)


def mapped(label: np.ndarray, table: np.ndarray, where: str) -> np.ndarray:
    """(h, w) uint8 of our classes, from those of a source by `table` (n,); SourceError for a class that the table does not have."""
    if label.size and (label.min() < 0 or label.max() >= len(table)):
        got = f"{int(label.min())} to {int(label.max())}"
        raise SourceError(where, f"labels 0 to {len(table) - 1}", got, "is it the label file?")
    return np.asarray(table[label.astype(np.intp)])
