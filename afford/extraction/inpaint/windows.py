"""Square crops around holes as network input; only the pixels of the hole are pasted back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import cv2
import numpy as np

T = TypeVar("T")
MIN_PX = 64
"""side of the smallest window: networks that downsample three times and pad by reflection need this much context"""
MARGIN = 0.25
"""margin on each side of a hole that does not fit into a window, as a share of its longer side"""


class Window(NamedTuple):
    """A square window; a window larger than the frame extends beyond its top or left edge."""

    y: int
    x: int
    side: int

    def inside(self, shape: tuple[int, ...]) -> tuple[slice, slice]:
        """Slices of a frame of this (height, width) that lie in the window."""
        height, width = shape[:2]
        return slice(max(self.y, 0), min(self.y + self.side, height)), slice(max(self.x, 0), min(self.x + self.side, width))


def chunks(items: Sequence[T], size: int) -> list[Sequence[T]]:
    """Split items into chunks of at most `size`, in order. ValueError for a size below 1."""
    if size < 1:
        raise ValueError(f"batch: expected 1 or more, got {size}")
    return [items[start : start + size] for start in range(0, len(items), size)]


def side_of(window_px: int, default: int) -> int:
    """Return the side given in Params, or `default` for 0. ValueError for a side that is too small."""
    if window_px and window_px < MIN_PX:
        raise ValueError(f"window_px: expected 0 or {MIN_PX} or more, got {window_px}")
    return window_px or default


def windows(hole: np.ndarray, side: int) -> list[Window]:
    """Cover a (h, w) bool hole with windows of `side` pixels, the one around the largest patch first.

    A window is larger than `side` only around a patch that would not fit.
    """
    left, found = hole.copy(), []
    while left.any():
        _, _, stats, _ = cv2.connectedComponentsWithStats(left.view(np.uint8), connectivity=8)
        patch = stats[1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))]
        found.append(_around(patch, side, hole.shape))
        left[found[-1].inside(hole.shape)] = False
    return found


def cut(image: np.ndarray, window: Window, size: int) -> np.ndarray:
    """Crop a window to (size, size, ...): a copy of the pixels where the window has that size, else scaled; black outside."""
    top, left = max(-window.y, 0), max(-window.x, 0)
    piece = image[window.inside(image.shape)]
    full = np.zeros((window.side, window.side, *image.shape[2:]), image.dtype)
    full[top : top + piece.shape[0], left : left + piece.shape[1]] = piece
    return full if window.side == size else _scaled(full, size)


def cut_hole(hole: np.ndarray, window: Window, size: int) -> np.ndarray:
    """Crop a hole to (size, size) bool; scaling keeps every pixel of the hole covered."""
    return cut(hole.astype(np.uint8) * 255, window, size) > 0


def paste(frame: np.ndarray, window: Window, crop: np.ndarray, where: np.ndarray) -> None:
    """Paste a (size, size, 3) uint8 crop of a window into a (h, w, 3) frame, in place, inside the mask `where` (h, w) bool."""
    full = crop if window.side == len(crop) else cv2.resize(crop, (window.side, window.side), interpolation=cv2.INTER_CUBIC)
    area = window.inside(frame.shape)
    pixels = full[area[0].start - window.y : area[0].stop - window.y, area[1].start - window.x : area[1].stop - window.x]
    frame[area][where[area]] = pixels[where[area]]


def _around(patch: np.ndarray, side: int, shape: tuple[int, ...]) -> Window:
    x, y, width, height = (int(value) for value in patch[:4])
    longer = max(width, height)
    side = side if longer <= side else int(longer * (1 + 2 * MARGIN))
    return Window(_start(y, height, side, shape[0]), _start(x, width, side, shape[1]), side)


def _start(start: int, length: int, side: int, limit: int) -> int:
    """First index of a window around start..start + length: centred, but inside the frame if it fits, else flush with its end."""
    if side >= limit:
        return limit - side
    return min(max(start + (length - side) // 2, 0), limit - side)


def _scaled(image: np.ndarray, size: int) -> np.ndarray:
    interpolation = cv2.INTER_AREA if size < len(image) else cv2.INTER_LINEAR
    return cv2.resize(image, (size, size), interpolation=interpolation)
