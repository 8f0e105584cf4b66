"""Large motion: the shift under which a small window of a frame is found again in the next, tried one by one on small pictures."""

from __future__ import annotations

import cv2
import numba
import numpy as np

SIDE_PX = 36
"""longer side of the small pictures"""
REACH = 0.36
"""longest shift along each axis, as a share of that side"""
HALF = 2
"""windows have 2 * HALF + 1 px on a side"""
LIMIT = np.float32(0.5)
"""largest difference of a pixel: what is hidden costs no more"""
PRICE = np.float32(0.001)
"""of a shift by one pixel: of two that fit alike the shorter one is taken"""


def search(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Shift of every pixel of `a`, (h, w, 2) float32 in px; pictures are (h, w, c) float32, a difference of 1 being large."""
    height, width = a.shape[:2]
    scale = SIDE_PX / max(height, width)
    size = (max(round(width * scale), 1), max(round(height * scale), 1))
    first, second = (np.ascontiguousarray(cv2.resize(one, size, interpolation=cv2.INTER_AREA)) for one in (a, b))
    found = shifts(first, second, round(REACH * SIDE_PX), HALF, LIMIT, PRICE)
    back = np.array([width / size[0], height / size[1]], np.float32)
    return cv2.resize(found, (width, height), interpolation=cv2.INTER_NEAREST) * back


@numba.njit(cache=True)
def shifts(a, b, reach, half, limit, price):  # type: ignore[no-untyped-def]  # numba infers
    """Best whole shift of the window around every pixel, (h, w, 2) float32; what lies outside of `b` costs `limit`."""
    height, width, channels = a.shape
    best = np.full((height, width), np.float32(1e9))
    found = np.zeros((height, width, 2), np.float32)
    total = np.zeros((height + 1, width + 1), np.float64)
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            for y in range(height):
                for x in range(width):
                    miss = limit
                    if 0 <= y + dy < height and 0 <= x + dx < width:
                        gap = np.float32(0.0)
                        for c in range(channels):
                            gap += abs(a[y, x, c] - b[y + dy, x + dx, c])
                        miss = min(gap, limit)
                    total[y + 1, x + 1] = miss + total[y, x + 1] + total[y + 1, x] - total[y, x]
            walk = price * np.sqrt(dx * dx + dy * dy)
            for y in range(height):
                top, bottom = max(y - half, 0), min(y + half + 1, height)
                for x in range(width):
                    left, right = max(x - half, 0), min(x + half + 1, width)
                    window = total[bottom, right] - total[top, right] - total[bottom, left] + total[top, left]
                    cost = window / ((bottom - top) * (right - left)) + walk
                    if cost < best[y, x]:
                        best[y, x] = cost
                        found[y, x, 0] = dx
                        found[y, x, 1] = dy
    return found
