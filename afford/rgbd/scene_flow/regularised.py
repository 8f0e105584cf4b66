"""Regularised scene flow: one motion per surface, rest without evidence of motion, no holes.

1. Holes of the depth are filled within regions of one colour.
2. Two hypotheses of the motion: optical flow from zero, and optical flow from a block matching search of large shifts. Each is
computed forwards and backwards; pixels where the two disagree (occlusion) get a low weight.
3. Flow and change of depth are smoothed within surfaces, which colour and depth separate, twice: the second time residuals of the
first reduce the weights (robust re-weighting).
4. Each pixel takes rest or the hypothesis that explains the second frame best on its surface. Motion must win by a margin, because
the camera stands still.

Large shifts are found by block matching on small pictures. Smoothing is the fast global smoother (Min et al. 2014): it minimises
sum w (u - f)^2 + smoothness * sum affinity |difference of neighbours of u|^2 by exact one-dimensional solves, alternating rows and
columns. Pixels of weight 0 take the values of their surface.
"""

from __future__ import annotations

import cv2
import numba
import numpy as np

from afford.common.optical_flow import flow_between
from afford.rgbd.scene_flow import Regularised
from afford.rgbd.scene_flow.clip import RgbdFrame, lift, warp

COLOUR_STEP = 12.0
"""difference of colour, 0..255 summed over channels / 3, that separates two surfaces"""
DEPTH_STEP = 0.02
"""relative difference of depth that separates two surfaces"""
GREY_NOISE = 4.0
SEARCH_M = 0.5
"""difference of depth that costs as much, in the search, as black against white of one channel"""
SMALL_PX = 200
"""longer side of pictures below which optical flow is computed at twice their size"""
FLOW_NOISE_PX = 0.5
"""disagreement of forward and backward flow at which the weight is a quarter"""


def between(a: RgbdFrame, b: RgbdFrame, params: Regularised) -> tuple[np.ndarray, np.ndarray]:
    """Motion from `a` to `b`: in space (h, w, 3) float32 in m, on the image (h, w, 2) float32 in px. Never NaN."""
    first_m, second_m = fill_depth(a), fill_depth(b)
    near = affinity(np.dstack([a.rgb.astype(np.float32) / (3 * COLOUR_STEP), np.log(first_m) / DEPTH_STEP]))
    shown = [np.dstack([one.rgb.astype(np.float32) / 255, depth_m / SEARCH_M]) for one, depth_m in ((a, first_m), (b, second_m))]
    far = block_matching(*shown), block_matching(*shown[::-1])
    guesses = [_guess(a, b, first_m, near, params, start) for start in ((None, None), far)]
    rest = np.zeros((*first_m.shape, 2), np.float32), np.zeros_like(first_m)
    flow_px, change_m = _best([rest, *guesses], a, b, near, params)
    return lift(flow_px, first_m, change_m, a.K), flow_px


def _guess(a: RgbdFrame, b: RgbdFrame, first_m: np.ndarray, near: tuple[np.ndarray, np.ndarray], params: Regularised,
           start: tuple[np.ndarray | None, np.ndarray | None]) -> tuple[np.ndarray, np.ndarray]:
    """One hypothesis: flow (h, w, 2) in px and change of depth (h, w) in m, without gaps, from initial optical flows."""
    flow_px, belief = _bidirectional_flow(a, b, *start)
    flow_px = _spread(flow_px, belief, near, params.smoothness)
    change_m, known = _change(a, b, first_m, flow_px)
    return flow_px, _spread(change_m[..., None], known * belief, near, params.smoothness)[..., 0]


def fill_depth(view: RgbdFrame) -> np.ndarray:
    """Depth (h, w) float32 in m without holes; 1 m everywhere without any measurement."""
    known = view.depth_m > 0
    if not known.any():
        return np.ones_like(view.depth_m)
    near = affinity(view.rgb.astype(np.float32) / (3 * COLOUR_STEP))
    guess = fast_global_smoother(view.depth_m[..., None], known.astype(np.float32), near, 100.0)[..., 0]
    return np.where(known, view.depth_m, np.maximum(guess, view.depth_m[known].min()))


def noise_m(depth_m: np.ndarray) -> np.ndarray:
    """Standard deviation of a structured-light or time-of-flight camera (Nguyen et al. 2012), m."""
    return 0.0012 + 0.0019 * (depth_m - 0.4) ** 2


def _bidirectional_flow(a: RgbdFrame, b: RgbdFrame, start: np.ndarray | None,
                        back_start: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Optical flow (h, w, 2) and its forward-backward consistency weight, 0..1."""
    there, back = _optical_flow(a.grey, b.grey, start), _optical_flow(b.grey, a.grey, back_start)
    gap = np.linalg.norm(there + warp(back, there), axis=-1)
    return there, (1 / (1 + (gap / FLOW_NOISE_PX) ** 2)).astype(np.float32) ** 2


def _optical_flow(a: np.ndarray, b: np.ndarray, start: np.ndarray | None) -> np.ndarray:
    """Optical flow; small pictures are enlarged twofold, so that fingers are wider than the patches of the method."""
    height, width = a.shape
    if max(height, width) > SMALL_PX:
        return flow_between(a, b, start=start)
    size = (2 * width, 2 * height)
    first, second = (cv2.resize(one, size, interpolation=cv2.INTER_CUBIC) for one in (a, b))
    begin = None if start is None else 2 * cv2.resize(start, size, interpolation=cv2.INTER_NEAREST)
    found = flow_between(first, second, start=begin)
    return cv2.resize(found, (width, height), interpolation=cv2.INTER_AREA) / 2


def _spread(values: np.ndarray, belief: np.ndarray, near: tuple[np.ndarray, np.ndarray], smoothness: float) -> np.ndarray:
    """Smooth weighted values over their surfaces, robustly."""
    first = fast_global_smoother(values, belief, near, smoothness)
    miss = np.linalg.norm(values - first, axis=-1)
    usual = np.median(miss) + 1e-4
    return fast_global_smoother(values, belief / (1 + (miss / (2 * usual)) ** 2), near, smoothness)


def _change(a: RgbdFrame, b: RgbdFrame, first_m: np.ndarray, flow_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Change of depth along the flow, (h, w) m, and 1 where it was measured, else 0."""
    later_m = warp(b.depth_m, flow_px, nearest=True)
    change_m = later_m - first_m
    known = (later_m > 0) & (a.depth_m > 0) & (np.abs(change_m) < 0.08 * first_m)
    return np.where(known, change_m, 0).astype(np.float32), known.astype(np.float32)


def _best(guesses: list[tuple[np.ndarray, np.ndarray]], a: RgbdFrame, b: RgbdFrame, near: tuple[np.ndarray, np.ndarray],
          params: Regularised) -> tuple[np.ndarray, np.ndarray]:
    """Choose for every pixel the hypothesis that explains `b` best; rest, the first one, unless another wins by the margin."""
    misfit = np.dstack([_misfit(a, b, *guess) for guess in guesses])
    cost = fast_global_smoother(misfit, np.ones_like(misfit[..., 0]), near, params.smoothness)
    cost[..., 0] -= params.still_margin
    chosen = cost.argmin(-1)
    return (np.choose(chosen[..., None], [flow_px for flow_px, _ in guesses]), np.choose(chosen, [change for _, change in guesses]))


def _misfit(a: RgbdFrame, b: RgbdFrame, flow_px: np.ndarray, change_m: np.ndarray) -> np.ndarray:
    """Residual of a motion in `b`, (h, w) in standard deviations of the noise, colour and depth at most 4 each."""
    grey = np.abs(warp(b.grey.astype(np.float32), flow_px) - cv2.GaussianBlur(a.grey.astype(np.float32), (3, 3), 0)) / GREY_NOISE
    later_m = warp(b.depth_m, flow_px, nearest=True)
    depth = np.abs(later_m - a.depth_m - change_m) / noise_m(a.depth_m)
    depth[(later_m == 0) | (a.depth_m == 0)] = 0
    return (np.minimum(grey, 4) + np.minimum(depth, 4)).astype(np.float32)


SIDE_PX = 36
"""longer side of the small pictures of block matching"""
REACH = 0.36
"""longest shift along each axis, as a share of that side"""
HALF = 2
"""windows have 2 * HALF + 1 px on a side"""
LIMIT = np.float32(0.5)
"""largest cost of a pixel, which also bounds the cost of occlusions"""
PRICE = np.float32(0.001)
"""cost of a shift by one pixel: of two equal matches the shorter shift wins"""


def block_matching(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Block matching: shift of every pixel of `a`, (h, w, 2) float32 in px.

    Pictures are (h, w, c) float32, scaled so that a difference of 1 is large.
    """
    height, width = a.shape[:2]
    scale = SIDE_PX / max(height, width)
    size = (max(round(width * scale), 1), max(round(height * scale), 1))
    first, second = (np.ascontiguousarray(cv2.resize(one, size, interpolation=cv2.INTER_AREA)) for one in (a, b))
    found = best_shifts(first, second, round(REACH * SIDE_PX), HALF, LIMIT, PRICE)
    back = np.array([width / size[0], height / size[1]], np.float32)
    return cv2.resize(found, (width, height), interpolation=cv2.INTER_NEAREST) * back


@numba.njit(cache=True)
def best_shifts(a, b, reach, half, limit, price):  # type: ignore[no-untyped-def]  # numba infers
    """Best integer shift of the window around every pixel, (h, w, 2) float32; pixels outside of `b` cost `limit`."""
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


ROUNDS = 3
TINY = np.float32(1e-6)


def affinity(guide: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Affinity of neighbours, 0..1: along rows (h, w - 1) and, transposed, along columns (w, h - 1).

    `guide` is (h, w, c) float32, scaled so that a difference of 1 separates two pixels (e^-1).
    """
    rows = np.exp(-np.abs(np.diff(guide, axis=1)).sum(-1))
    columns = np.exp(-np.abs(np.diff(guide, axis=0)).sum(-1)).T
    return rows.astype(np.float32), np.ascontiguousarray(columns.astype(np.float32))


def fast_global_smoother(values: np.ndarray, weight: np.ndarray, near: tuple[np.ndarray, np.ndarray],
                         smoothness: float) -> np.ndarray:  # fmt: skip
    """Smooth values (h, w, c) float32 with weights (h, w) >= 0, within the surfaces of `near` (`affinity`).

    Surfaces without any weight get values near the weighted mean.
    """
    believed = np.maximum(weight, TINY)[..., None].astype(np.float32)
    mean = (values * believed).sum((0, 1)) / believed.sum()
    both = np.concatenate([(values - mean) * believed, believed], -1).astype(np.float32)
    for turn in range(ROUNDS):
        strength = np.float32(smoothness * 1.5 * 4.0 ** (ROUNDS - 1 - turn) / (4.0**ROUNDS - 1))
        solve_rows(both, near[0], strength)
        across = np.ascontiguousarray(both.swapaxes(0, 1))
        solve_rows(across, near[1], strength)
        both = np.ascontiguousarray(across.swapaxes(0, 1))
    return both[..., :-1] / both[..., -1:] + mean


@numba.njit(cache=True)
def solve_rows(values, near, strength):  # type: ignore[no-untyped-def]  # numba infers
    """Solve every row of `values` (n, m, c) in place: (1 + strength * links) u - strength * links * neighbours = values.

    The tridiagonal systems are solved by Thomas's algorithm.
    """
    count, length, channels = values.shape
    upper = np.empty(length, np.float32)
    for row in range(count):
        left = np.float32(0.0)
        carry = np.float32(0.0)
        for n in range(length):
            right = strength * near[row, n] if n + 1 < length else np.float32(0.0)
            pivot = np.float32(1.0) / (np.float32(1.0) + left + right - left * carry)
            for c in range(channels):
                before = left * values[row, n - 1, c] if n > 0 else np.float32(0.0)
                values[row, n, c] = (values[row, n, c] + before) * pivot
            carry = right * pivot
            upper[n] = carry
            left = right
        for n in range(length - 2, -1, -1):
            for c in range(channels):
                values[row, n, c] += upper[n] * values[row, n + 1, c]
