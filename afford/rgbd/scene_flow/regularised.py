"""Scene flow that is regularised: one motion per surface, rest where nothing speaks for motion, no holes.

1. Holes of the depth are filled within what has one colour.
2. Two guesses of the motion: optical flow from nothing, and from a search of large shifts. Each both ways; where the two ways
   disagree it is not believed (occlusion).
3. Flow and change of depth are spread from where they are believed, within surfaces (colour and depth part them), twice: the
   second time what does not fit the first result counts less (robust re-weighting).
4. Of rest and the two guesses each pixel takes the one that explains the second frame best, as its surface sees it; motion must
   do so by a margin, for the camera stands.
"""

from __future__ import annotations

import cv2
import numpy as np

from afford.common.optical_flow import flow_between
from afford.rgbd.scene_flow import Regularised
from afford.rgbd.scene_flow.search import search
from afford.rgbd.scene_flow.smooth import affinity, smooth
from afford.rgbd.scene_flow.view import View, carried, lift

COLOUR_STEP = 12.0
"""difference of colour, 0..255 summed over channels / 3, that parts two surfaces"""
DEPTH_STEP = 0.02
"""relative difference of depth that does"""
GREY_NOISE = 4.0
SEARCH_M = 0.5
"""difference of depth that is as large, in the search, as black and white of one colour"""
SMALL_PX = 200
"""longer side of pictures whose optical flow is found at twice their size"""
FLOW_NOISE_PX = 0.5
"""disagreement of the two optical flows at which belief is halved"""


def between(a: View, b: View, params: Regularised) -> tuple[np.ndarray, np.ndarray]:
    """Motion from `a` to `b`: in space (h, w, 3) float32 in m, on the image (h, w, 2) float32 in px. Never NaN."""
    first_m, second_m = filled(a), filled(b)
    near = affinity(np.dstack([a.rgb.astype(np.float32) / (3 * COLOUR_STEP), np.log(first_m) / DEPTH_STEP]))
    shown = [np.dstack([one.rgb.astype(np.float32) / 255, depth_m / SEARCH_M]) for one, depth_m in ((a, first_m), (b, second_m))]
    far = search(*shown), search(*shown[::-1])
    guesses = [_guess(a, b, first_m, near, params, start) for start in ((None, None), far)]
    rest = np.zeros((*first_m.shape, 2), np.float32), np.zeros_like(first_m)
    flow_px, change_m = _best([rest, *guesses], a, b, near, params)
    return lift(flow_px, first_m, change_m, a.K), flow_px


def _guess(a: View, b: View, first_m: np.ndarray, near: tuple[np.ndarray, np.ndarray], params: Regularised,
           start: tuple[np.ndarray | None, np.ndarray | None]) -> tuple[np.ndarray, np.ndarray]:
    """Flow (h, w, 2) in px and change of depth (h, w) in m, without gaps, from optical flows that start at `start`, both ways."""
    flow_px, belief = _seen(a, b, *start)
    flow_px = _spread(flow_px, belief, near, params.smoothness)
    change_m, known = _change(a, b, first_m, flow_px)
    return flow_px, _spread(change_m[..., None], known * belief, near, params.smoothness)[..., 0]


def filled(view: View) -> np.ndarray:
    """Depth (h, w) float32 in m without holes; 1 m everywhere where nothing was measured."""
    known = view.depth_m > 0
    if not known.any():
        return np.ones_like(view.depth_m)
    near = affinity(view.rgb.astype(np.float32) / (3 * COLOUR_STEP))
    guess = smooth(view.depth_m[..., None], known.astype(np.float32), near, 100.0)[..., 0]
    return np.where(known, view.depth_m, np.maximum(guess, view.depth_m[known].min()))


def noise_m(depth_m: np.ndarray) -> np.ndarray:
    """Standard deviation of a structured-light or time-of-flight camera (Nguyen et al. 2012), m."""
    return 0.0012 + 0.0019 * (depth_m - 0.4) ** 2


def _seen(a: View, b: View, start: np.ndarray | None, back_start: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Optical flow (h, w, 2), and how far to believe it, 0..1."""
    there, back = _optical(a.grey, b.grey, start), _optical(b.grey, a.grey, back_start)
    gap = np.linalg.norm(there + carried(back, there), axis=-1)
    return there, (1 / (1 + (gap / FLOW_NOISE_PX) ** 2)).astype(np.float32) ** 2


def _optical(a: np.ndarray, b: np.ndarray, start: np.ndarray | None) -> np.ndarray:
    """Optical flow of small pictures at twice their size, where fingers are wider than its patches."""
    height, width = a.shape
    if max(height, width) > SMALL_PX:
        return flow_between(a, b, start=start)
    size = (2 * width, 2 * height)
    first, second = (cv2.resize(one, size, interpolation=cv2.INTER_CUBIC) for one in (a, b))
    begin = None if start is None else 2 * cv2.resize(start, size, interpolation=cv2.INTER_NEAREST)
    found = flow_between(first, second, start=begin)
    return cv2.resize(found, (width, height), interpolation=cv2.INTER_AREA) / 2


def _spread(values: np.ndarray, belief: np.ndarray, near: tuple[np.ndarray, np.ndarray], smoothness: float) -> np.ndarray:
    """Believed values over their surfaces, robustly."""
    first = smooth(values, belief, near, smoothness)
    miss = np.linalg.norm(values - first, axis=-1)
    usual = np.median(miss) + 1e-4
    return smooth(values, belief / (1 + (miss / (2 * usual)) ** 2), near, smoothness)


def _change(a: View, b: View, first_m: np.ndarray, flow_px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Change of depth along the flow, (h, w) m, and where it was measured, 0 or 1."""
    later_m = carried(b.depth_m, flow_px, nearest=True)
    change_m = later_m - first_m
    known = (later_m > 0) & (a.depth_m > 0) & (np.abs(change_m) < 0.08 * first_m)
    return np.where(known, change_m, 0).astype(np.float32), known.astype(np.float32)


def _best(guesses: list[tuple[np.ndarray, np.ndarray]], a: View, b: View, near: tuple[np.ndarray, np.ndarray],
          params: Regularised) -> tuple[np.ndarray, np.ndarray]:
    """For every pixel the guess that explains `b` best; the first one, rest, unless another is better by the margin."""
    misfit = np.dstack([_misfit(a, b, *guess) for guess in guesses])
    cost = smooth(misfit, np.ones_like(misfit[..., 0]), near, params.smoothness)
    cost[..., 0] -= params.still_margin
    chosen = cost.argmin(-1)
    return (np.choose(chosen[..., None], [flow_px for flow_px, _ in guesses]), np.choose(chosen, [change for _, change in guesses]))


def _misfit(a: View, b: View, flow_px: np.ndarray, change_m: np.ndarray) -> np.ndarray:
    """How badly a motion explains `b`, (h, w) in standard deviations of the noise, each kind at most 4."""
    grey = np.abs(carried(b.grey.astype(np.float32), flow_px) - cv2.GaussianBlur(a.grey.astype(np.float32), (3, 3), 0)) / GREY_NOISE
    later_m = carried(b.depth_m, flow_px, nearest=True)
    depth = np.abs(later_m - a.depth_m - change_m) / noise_m(a.depth_m)
    depth[(later_m == 0) | (a.depth_m == 0)] = 0
    return (np.minimum(grey, 4) + np.minimum(depth, 4)).astype(np.float32)
