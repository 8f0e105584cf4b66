"""Motion that is too fast for optical flow: an arm that enters the image moves by tens of pixels per frame.

Each entity is looked for as a whole, at a quarter of the size, and what is found there competes with the flow per pixel.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit

from afford.common.optical_flow import flow_between, identity_map

SCALE = 4
"""the search runs at 1 / SCALE of the size"""
FARTHEST_PX = 64
"""largest step between neighbouring frames that is looked for"""
FAST_PX = 8
"""steps below this are left to optical flow"""
IN_SIGHT = 0.15
"""share of the entity that must stay inside the image for a step to be judged"""
BETTER = 0.8
"""the difference after the step must be this much of the difference without it"""


def step_between(grey: np.ndarray, last: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Flow (h, w, 2) from a frame to its neighbour `last`, both (h, w) uint8, whose labels (h, w) int16 are known."""
    flow = flow_between(grey, last)
    leaps = _leaps(_small(grey), _small(last), labels)
    if not leaps:
        return flow
    start = flow.copy()
    for label, (x, y) in leaps:
        shift = np.array([[1, 0, x], [0, 1, y]], np.float32)
        here = cv2.warpAffine((labels == label).astype(np.uint8), shift, grey.shape[::-1], flags=cv2.INTER_NEAREST) > 0
        start[here] = (-x, -y)
    return better_of(grey, last, [flow, start, flow_between(grey, last, start=start)])


def better_of(grey: np.ndarray, other: np.ndarray, flows: list[np.ndarray]) -> np.ndarray:
    """Per pixel, of several flows from `grey` to `other` the one with the smallest grey difference around it."""
    height, width = grey.shape
    best, least = flows[0], None
    for flow in flows:
        shown = cv2.remap(other, identity_map(height, width) + flow, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        difference = cv2.blur(cv2.absdiff(shown, grey).astype(np.float32), (7, 7))
        if least is None:
            least = difference
        else:
            best = np.where((difference < least)[..., None], flow, best)
            least = np.minimum(least, difference)
    return best


def _leaps(small: np.ndarray, last: np.ndarray, labels: np.ndarray) -> list[tuple[int, tuple[int, int]]]:
    """Entities that moved fast, with their step (x, y) in px from `last` to the new frame."""
    shrunk = labels[SCALE // 2 :: SCALE, SCALE // 2 :: SCALE][: small.shape[0], : small.shape[1]]
    out = []
    for label in np.unique(shrunk[shrunk > 0]).tolist():
        pixels = np.argwhere(shrunk == label)
        x, y, gain = _search(small, last, pixels, FARTHEST_PX // SCALE)
        if max(abs(x), abs(y)) * SCALE >= FAST_PX and gain < BETTER:
            out.append((label, (x * SCALE, y * SCALE)))
    return out


def _small(grey: np.ndarray) -> np.ndarray:
    return cv2.resize(grey, (grey.shape[1] // SCALE, grey.shape[0] // SCALE), interpolation=cv2.INTER_AREA)


@njit(cache=True)
def _search(small: np.ndarray, last: np.ndarray, pixels: np.ndarray, reach: int) -> tuple[int, int, float]:
    """Shift (x, y) of `pixels` (p, 2: y, x) of `last` that fits `small` best, and its difference relative to no shift."""
    height, width = small.shape
    best, still, best_x, best_y = 1e9, 1e9, 0, 0
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            total, count = np.int64(0), 0
            for p in range(len(pixels)):
                y, x = pixels[p, 0] + dy, pixels[p, 1] + dx
                if 0 <= y < height and 0 <= x < width:
                    total += abs(np.int64(small[y, x]) - np.int64(last[pixels[p, 0], pixels[p, 1]]))
                    count += 1
            if count >= max(IN_SIGHT * len(pixels), 4):
                mean = total / count
                if dx == 0 and dy == 0:
                    still = mean
                if mean < best:
                    best, best_x, best_y = mean, dx, dy
    return best_x, best_y, best / max(still, 1e-6)
