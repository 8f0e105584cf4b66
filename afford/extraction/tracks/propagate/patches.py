"""Which entity does a pixel belong to? Ask where the patch around it is found again in a key frame.

Optical flow is one smooth field, but at an outline two things move differently, and the flow of one bleeds over the other. So
a pixel tries the motions of its neighbourhood, not only its own, each with a small search, and every entity keeps its best
match. Patches compare colour with weights that fade for taps unlike the centre (Yoon and Kweon 2006), so that a patch across
an outline speaks for the side on which its centre lies.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit

REACH_PX = 4
"""half the size of a patch"""
TAPS = np.array(sorted(((x, y) for y in range(-4, 5, 2) for x in range(-4, 5, 2)), key=lambda p: (np.hypot(*p), p)), np.int64)
"""offsets at which patches are compared, the near ones first"""
NEIGHBOURS = np.array(
    [(0, 0)] + [(round(r * np.cos(a)), round(r * np.sin(a))) for r in (4, 8) for a in np.arange(8) * np.pi / 4], np.int64
)
"""offsets whose motions a pixel tries"""
SIMILAR = np.float32(20)
"""colour difference to the centre at which the weight of a tap has fallen to 1/e; sum over Lab, 0..255 each"""
CAP = np.float32(60)
"""largest colour difference that one tap can cost"""
SHIFT_COST = np.float32(0.5)
"""cost of one px of search"""
MARGIN = np.float32(12)
"""a match that is worse than the best one by more than this decides nothing"""
UNMATCHED = np.float32(30)
"""cost of an entity that no patch speaks for"""


def colours(rgb: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8 RGB -> (h + 8, w + 8, 3) uint8 Lab, slightly smoothed against noise, borders repeated."""
    lab = cv2.cvtColor(cv2.GaussianBlur(rgb, (0, 0), 0.7), cv2.COLOR_RGB2LAB)
    return cv2.copyMakeBorder(lab, REACH_PX, REACH_PX, REACH_PX, REACH_PX, cv2.BORDER_REPLICATE)


@njit(cache=True, fastmath=True)
def match(
    target: np.ndarray,
    key: np.ndarray,
    labels: np.ndarray,
    flow: np.ndarray,
    where: np.ndarray,
    search_px: int,
    doubt: np.float32,
    cost: np.ndarray,
) -> None:
    """Lower `cost` (p, l) float32 of the p pixels `where` (p, 2: y, x) of a frame by what matches them in one key frame.

    target, key: `colours` of the frame and of the key frame. labels: (h, w) int16 of the key frame, negative = unknown.
    flow: (h, w, 2) from the frame to the key frame, px. Costs are mean colour differences, sum over Lab, plus `doubt`.
    """
    weight, centre = np.zeros(len(TAPS), np.float32), np.zeros((len(TAPS), 3), np.int32)
    tried = np.zeros((len(NEIGHBOURS), 2), np.int64)
    height, width = labels.shape
    for p in range(len(where)):
        y, x = where[p, 0], where[p, 1]
        _look(target, y + REACH_PX, x + REACH_PX, weight, centre)
        best = cost[p].min()
        for n in range(_motions(flow, y, x, tried)):
            cy, cx = y + tried[n, 0], x + tried[n, 1]
            inside = 0 <= cy < height and 0 <= cx < width
            if inside and _difference(key, cy, cx, weight, centre, best + MARGIN, np.float32(0)) > best + MARGIN:
                continue
            for qy in range(max(cy - search_px, 0), min(cy + search_px + 1, height)):
                for qx in range(max(cx - search_px, 0), min(cx + search_px + 1, width)):
                    label = labels[qy, qx]
                    if label < 0:
                        continue
                    limit = min(cost[p, label], best + MARGIN)
                    start = doubt + SHIFT_COST * (abs(qy - cy) + abs(qx - cx))
                    found = _difference(key, qy, qx, weight, centre, limit, start)
                    if found < limit:
                        cost[p, label] = found
                        best = min(best, found)


@njit(cache=True, fastmath=True)
def _look(target: np.ndarray, y: int, x: int, weight: np.ndarray, centre: np.ndarray) -> None:
    """Colours of the taps around a pixel, and their weights, which sum to 1."""
    total = np.float32(0)
    for j in range(len(TAPS)):
        far = np.float32(0)
        for c in range(3):
            centre[j, c] = target[y + TAPS[j, 1], x + TAPS[j, 0], c]
            far += abs(centre[j, c] - np.int32(target[y, x, c]))
        weight[j] = np.exp(-far / SIMILAR)
        total += weight[j]
    weight /= total


@njit(cache=True, fastmath=True)
def _motions(flow: np.ndarray, y: int, x: int, tried: np.ndarray) -> int:
    """Whole-px motions (y, x) of the neighbourhood that differ by more than 1 px, written to `tried`; their number."""
    count = 0
    for r in range(len(NEIGHBOURS)):
        qy = min(max(y + NEIGHBOURS[r, 1], 0), flow.shape[0] - 1)
        qx = min(max(x + NEIGHBOURS[r, 0], 0), flow.shape[1] - 1)
        vy, vx = int(np.rint(flow[qy, qx, 1])), int(np.rint(flow[qy, qx, 0]))
        new = True
        for n in range(count):
            if abs(tried[n, 0] - vy) <= 1 and abs(tried[n, 1] - vx) <= 1:
                new = False
                break
        if new:
            tried[count, 0], tried[count, 1] = vy, vx
            count += 1
    return count


@njit(cache=True, fastmath=True)
def _difference(
    key: np.ndarray, y: int, x: int, weight: np.ndarray, centre: np.ndarray, limit: np.float32, start: np.float32
) -> np.float32:
    """Weighted colour difference of the patch at (y, x) of a key frame, plus `start`; given up once above `limit`."""
    total = start
    for j in range(len(TAPS)):
        ky, kx = y + TAPS[j, 1] + REACH_PX, x + TAPS[j, 0] + REACH_PX
        far = (
            abs(centre[j, 0] - np.int32(key[ky, kx, 0]))
            + abs(centre[j, 1] - np.int32(key[ky, kx, 1]))
            + abs(centre[j, 2] - np.int32(key[ky, kx, 2]))
        )
        total += weight[j] * min(np.float32(far), CAP)
        if total > limit:
            break
    return total
