"""Square windows around holes, so that what a network sees is cut out of a frame and only its hole is pasted back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import cv2
import numpy as np

T = TypeVar("T")
MIN_PX = 64
"""side of the smallest window: a network that halves three times and pads by mirroring needs this much to see anything"""
MARGIN = 0.25
"""of the longer side of a hole that does not fit into a window, which is left free around it on each side"""


class Window(NamedTuple):
    """A square; where it is larger than the frame it sticks out at the top or at the left."""

    y: int
    x: int
    side: int

    def inside(self, shape: tuple[int, ...]) -> tuple[slice, slice]:
        """The part of a frame of this (height, width) that lies in the window."""
        height, width = shape[:2]
        return slice(max(self.y, 0), min(self.y + self.side, height)), slice(max(self.x, 0), min(self.x + self.side, width))


def chunks(items: Sequence[T], size: int) -> list[Sequence[T]]:
    """At most `size` items each, in order. ValueError for a size below 1."""
    if size < 1:
        raise ValueError(f"batch: expected 1 or more, got {size}")
    return [items[start : start + size] for start in range(0, len(items), size)]


def side_of(window_px: int, default: int) -> int:
    """The side that Params ask for, or `default` for 0. ValueError for one that is too small."""
    if window_px and window_px < MIN_PX:
        raise ValueError(f"window_px: expected 0 or {MIN_PX} or more, got {window_px}")
    return window_px or default


def windows(hole: np.ndarray, side: int) -> list[Window]:
    """Windows of `side` pixels or more that cover a (h, w) bool hole, the one around the largest patch first. A window is larger
    than `side` only around a patch that would not fit.
    """
    left, found = hole.copy(), []
    while left.any():
        _, _, stats, _ = cv2.connectedComponentsWithStats(left.view(np.uint8), connectivity=8)
        patch = stats[1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))]
        found.append(_around(patch, side, hole.shape))
        left[found[-1].inside(hole.shape)] = False
    return found


def cut(image: np.ndarray, window: Window, size: int) -> np.ndarray:
    """(size, size, ...) of what is in a window: the very pixels where the window has that size, else scaled; black outside."""
    top, left = max(-window.y, 0), max(-window.x, 0)
    piece = image[window.inside(image.shape)]
    full = np.zeros((window.side, window.side, *image.shape[2:]), image.dtype)
    full[top : top + piece.shape[0], left : left + piece.shape[1]] = piece
    return full if window.side == size else _scaled(full, size)


def cut_hole(hole: np.ndarray, window: Window, size: int) -> np.ndarray:
    """(size, size) bool; when scaled, it leaves out no pixel of the hole."""
    return cut(hole.astype(np.uint8) * 255, window, size) > 0


def paste(frame: np.ndarray, window: Window, found: np.ndarray, where: np.ndarray) -> None:
    """Write a (size, size, 3) uint8 answer for a window into a (h, w, 3) frame, in place, where (h, w) bool says so."""
    full = found if window.side == len(found) else cv2.resize(found, (window.side, window.side), interpolation=cv2.INTER_CUBIC)
    area = window.inside(frame.shape)
    answer = full[area[0].start - window.y : area[0].stop - window.y, area[1].start - window.x : area[1].stop - window.x]
    frame[area][where[area]] = answer[where[area]]


def _around(patch: np.ndarray, side: int, shape: tuple[int, ...]) -> Window:
    x, y, width, height = (int(value) for value in patch[:4])
    longer = max(width, height)
    side = side if longer <= side else int(longer * (1 + 2 * MARGIN))
    return Window(_start(y, height, side, shape[0]), _start(x, width, side, shape[1]), side)


def _start(start: int, length: int, side: int, limit: int) -> int:
    """Where a window around start..start + length begins: centred, but within the frame if it fits, else flush with its end."""
    if side >= limit:
        return limit - side
    return min(max(start + (length - side) // 2, 0), limit - side)


def _scaled(image: np.ndarray, size: int) -> np.ndarray:
    how = cv2.INTER_AREA if size < len(image) else cv2.INTER_LINEAR
    return cv2.resize(image, (size, size), interpolation=how)
