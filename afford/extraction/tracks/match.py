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

from afford.common.optical_flow import flow_between, identity_map

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
