"""Motion between two frames: patch matching at outlines, and a coarse search for entities that move too fast for optical flow.

Optical flow is one smooth field. At an outline two surfaces move differently, and the flow of one bleeds over the other. So a
pixel tries the motions of its neighbourhood, each with a small search, and every entity keeps its best match. Adaptive support
weights (Yoon and Kweon 2006) lower the weight of taps whose colour differs from the centre, so that a patch across an outline
represents the side of its centre.

An arm that enters the image moves by tens of pixels per frame. The coarse search shifts each entity as a whole at a quarter of the
size, and the shift competes with optical flow at every pixel.
"""

from __future__ import annotations

import cv2
import numpy as np
from numba import njit

from afford.common.optical_flow import flow_between, identity_map

REACH_PX = 4
"""half the size of a patch"""
TAPS = np.array(sorted(((x, y) for y in range(-4, 5, 2) for x in range(-4, 5, 2)), key=lambda p: (np.hypot(*p), p)), np.int64)
"""offsets (x, y) at which patches are compared, nearest first"""
MOTION_OFFSETS = np.array(
    [(0, 0)] + [(round(r * np.cos(a)), round(r * np.sin(a))) for r in (4, 8) for a in np.arange(8) * np.pi / 4], np.int64
)
"""offsets (x, y) of the neighbours whose motions a pixel tries"""
COLOUR_FALLOFF = np.float32(20)
"""colour difference from the centre at which the weight of a tap falls to 1/e; sum over Lab, 0..255 each"""
CAP = np.float32(60)
"""largest colour difference that one tap can contribute"""
SHIFT_COST = np.float32(0.5)
"""cost of one px of search"""
MARGIN = np.float32(12)
"""a match that is worse than the best one by more than this is ignored"""
UNMATCHED = np.float32(30)
"""cost of an entity without a matching patch"""


def padded_lab(rgb: np.ndarray) -> np.ndarray:
    """Convert (h, w, 3) uint8 RGB to (h + 8, w + 8, 3) uint8 Lab, slightly smoothed, with replicated borders."""
    lab = cv2.cvtColor(cv2.GaussianBlur(rgb, (0, 0), 0.7), cv2.COLOR_RGB2LAB)
    return cv2.copyMakeBorder(lab, REACH_PX, REACH_PX, REACH_PX, REACH_PX, cv2.BORDER_REPLICATE)


@njit(cache=True, fastmath=True)
def patch_match(
    target: np.ndarray,
    key: np.ndarray,
    labels: np.ndarray,
    flow: np.ndarray,
    where: np.ndarray,
    search_px: int,
    extra_cost: np.float32,
    cost: np.ndarray,
) -> None:
    """Match the patches of p pixels in one key frame, and lower `cost` (p, l) float32 of the labels that they match, in place.

    target, key: `padded_lab` of the frame and of the key frame. labels: (h, w) int16 of the key frame, negative = unknown.
    flow: (h, w, 2) from the frame to the key frame, px. where: (p, 2) y, x of the pixels. A cost is the mean colour difference,
    summed over Lab, plus `extra_cost`.
    """
    weight, centre = np.zeros(len(TAPS), np.float32), np.zeros((len(TAPS), 3), np.int32)
    tried = np.zeros((len(MOTION_OFFSETS), 2), np.int64)
    height, width = labels.shape
    for p in range(len(where)):
        y, x = where[p, 0], where[p, 1]
        _sample_taps(target, y + REACH_PX, x + REACH_PX, weight, centre)
        best = cost[p].min()
        for n in range(_candidate_motions(flow, y, x, tried)):
            cy, cx = y + tried[n, 0], x + tried[n, 1]
            inside = 0 <= cy < height and 0 <= cx < width
            if inside and _patch_difference(key, cy, cx, weight, centre, best + MARGIN, np.float32(0)) > best + MARGIN:
                continue
            for qy in range(max(cy - search_px, 0), min(cy + search_px + 1, height)):
                for qx in range(max(cx - search_px, 0), min(cx + search_px + 1, width)):
                    label = labels[qy, qx]
                    if label < 0:
                        continue
                    limit = min(cost[p, label], best + MARGIN)
                    start = extra_cost + SHIFT_COST * (abs(qy - cy) + abs(qx - cx))
                    found = _patch_difference(key, qy, qx, weight, centre, limit, start)
                    if found < limit:
                        cost[p, label] = found
                        best = min(best, found)


@njit(cache=True, fastmath=True)
def _sample_taps(target: np.ndarray, y: int, x: int, weight: np.ndarray, centre: np.ndarray) -> None:
    """Write the colours of the taps around a pixel to `centre`, and their weights, which sum to 1, to `weight`."""
    total = np.float32(0)
    for j in range(len(TAPS)):
        far = np.float32(0)
        for c in range(3):
            centre[j, c] = target[y + TAPS[j, 1], x + TAPS[j, 0], c]
            far += abs(centre[j, c] - np.int32(target[y, x, c]))
        weight[j] = np.exp(-far / COLOUR_FALLOFF)
        total += weight[j]
    weight /= total


@njit(cache=True, fastmath=True)
def _candidate_motions(flow: np.ndarray, y: int, x: int, tried: np.ndarray) -> int:
    """Write the distinct whole-pixel motions (y, x) of the neighbourhood to `tried`; returns their number."""
    count = 0
    for r in range(len(MOTION_OFFSETS)):
        qy = min(max(y + MOTION_OFFSETS[r, 1], 0), flow.shape[0] - 1)
        qx = min(max(x + MOTION_OFFSETS[r, 0], 0), flow.shape[1] - 1)
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
def _patch_difference(
    key: np.ndarray, y: int, x: int, weight: np.ndarray, centre: np.ndarray, limit: np.float32, start: np.float32
) -> np.float32:
    """Weighted colour difference of the patch at (y, x) of a key frame, plus `start`; stops early above `limit`."""
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
"""downscaling factor of the coarse search"""
FARTHEST_PX = 64
"""largest shift between neighbouring frames that the coarse search tries"""
FAST_PX = 8
"""smaller shifts are left to optical flow"""
MIN_VISIBLE_SHARE = 0.15
"""share of the entity that must stay inside the image for a shift to count"""
MAX_RELATIVE_DIFFERENCE = 0.8
"""largest difference after the shift, relative to the difference without a shift"""


def coarse_to_fine_flow(grey: np.ndarray, last: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Compute the flow (h, w, 2) from a frame to its neighbour `last`, both (h, w) uint8 grey.

    labels: (h, w) int16 of `last`. Entities that move fast start from the shift of a coarse search.
    """
    flow = flow_between(grey, last)
    shifts = _entity_shifts(_small(grey), _small(last), labels)
    if not shifts:
        return flow
    start = flow.copy()
    for label, (x, y) in shifts:
        shift = np.array([[1, 0, x], [0, 1, y]], np.float32)
        here = cv2.warpAffine((labels == label).astype(np.uint8), shift, grey.shape[::-1], flags=cv2.INTER_NEAREST) > 0
        start[here] = (-x, -y)
    return best_flow(grey, last, [flow, start, flow_between(grey, last, start=start)])


def best_flow(grey: np.ndarray, other: np.ndarray, flows: list[np.ndarray]) -> np.ndarray:
    """Select, per pixel, the flow from `grey` to `other` with the smallest grey difference in a 7 x 7 window."""
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


def _entity_shifts(small: np.ndarray, last: np.ndarray, labels: np.ndarray) -> list[tuple[int, tuple[int, int]]]:
    """Fast entities, each as label and shift (x, y) in px from `last` to the new frame."""
    shrunk = labels[SCALE // 2 :: SCALE, SCALE // 2 :: SCALE][: small.shape[0], : small.shape[1]]
    out = []
    for label in np.unique(shrunk[shrunk > 0]).tolist():
        pixels = np.argwhere(shrunk == label)
        x, y, gain = _search_shift(small, last, pixels, FARTHEST_PX // SCALE)
        if max(abs(x), abs(y)) * SCALE >= FAST_PX and gain < MAX_RELATIVE_DIFFERENCE:
            out.append((label, (x * SCALE, y * SCALE)))
    return out


def _small(grey: np.ndarray) -> np.ndarray:
    return cv2.resize(grey, (grey.shape[1] // SCALE, grey.shape[0] // SCALE), interpolation=cv2.INTER_AREA)


@njit(cache=True)
def _search_shift(small: np.ndarray, last: np.ndarray, pixels: np.ndarray, reach: int) -> tuple[int, int, float]:
    """Find the shift (x, y) of `pixels` (p, 2: y, x) of `last` that fits `small` best, and its cost relative to no shift."""
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
            if count >= max(MIN_VISIBLE_SHARE * len(pixels), 4):
                mean = total / count
                if dx == 0 and dy == 0:
                    still = mean
                if mean < best:
                    best, best_x, best_y = mean, dx, dy
    return best_x, best_y, best / max(still, 1e-6)
