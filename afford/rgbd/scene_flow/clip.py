"""Scene flow of a whole clip: RGB-D frames, motion lifted from the image to space, and its colour coding."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from afford.common.optical_flow import identity_map
from schemas.interaction import InteractionClip, SceneFlow


@dataclass(frozen=True)
class RgbdFrame:
    """One frame of a clip with its camera."""

    rgb: np.ndarray
    """(h, w, 3) uint8"""
    depth_m: np.ndarray
    """(h, w) float32 along the optical axis, m; 0 is a hole"""
    K: np.ndarray
    """(3, 3) float64, px"""

    @property
    def grey(self) -> np.ndarray:
        """Grey image, (h, w) uint8."""
        return cv2.cvtColor(self.rgb, cv2.COLOR_RGB2GRAY)


def lift(flow_px: np.ndarray, depth_m: np.ndarray, change_m: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Lift motion to space: (h, w, 3) float32 in m of points at `depth_m`.

    The points move by `flow_px` (h, w, 2) on the image and by `change_m` (h, w) along the optical axis.
    """
    focal, centre = (np.array(pair, np.float32) for pair in ((K[0, 0], K[1, 1]), (K[0, 2], K[1, 2])))
    ray = (identity_map(*depth_m.shape) + flow_px - centre) / focal
    across = flow_px / focal * depth_m[..., None] + ray * change_m[..., None]
    return np.dstack([across, change_m]).astype(np.float32)


def warp(image: np.ndarray, flow_px: np.ndarray, nearest: bool = False) -> np.ndarray:
    """Warp an image backwards: its value at x + flow(x), (h, w[, c]); beyond the border the border's value."""
    where = identity_map(*flow_px.shape[:2]) + flow_px
    return cv2.remap(image, where, None, cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


MIDDLE = 128
"""grey level of no motion for a fixed range"""


def fixed_range(flow: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """Map motion -limit..limit to grey levels 1..255, clipped; no motion has the same colour in every clip.

    `flow` is (s, h, w, c) float. Returns (s, h, w, c) uint8 and the colour of no motion, (c,) uint8.
    """
    scaled = np.clip(flow.astype(np.float32) / limit, -1, 1) * (MIDDLE - 1) + MIDDLE
    return scaled.round().astype(np.uint8), np.full(flow.shape[-1], MIDDLE, np.uint8)


def clip_range(flow: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """Map the minimum..maximum of a clip to 0..255, axis by axis, as in the paper; `limit` is ignored.

    An axis without motion is `MIDDLE`. Returns the same as `fixed_range`; the colour of no motion depends on the clip and is
    rounded to the nearest level.
    """
    axes = (0, 1, 2)
    low, high = (np.float32(end(flow, axis=axes, initial=0.0)) for end in (np.min, np.max))
    span = np.where(high > low, high - low, 1)
    still = np.where(high > low, -low / span * 255, MIDDLE)
    return (flow.astype(np.float32) / span * 255 + still).round().clip(0, 255).astype(np.uint8), still.round().astype(np.uint8)


Estimate = Callable[[RgbdFrame, RgbdFrame], tuple[np.ndarray, np.ndarray]]
"""a backend bound to its parameters, see `EstimateFlow`"""
RANGES = {"fixed": fixed_range, "clip": clip_range}


def scene_flow(clip: InteractionClip, between: Estimate, colour: str, range_m: float,
               range_share: float) -> SceneFlow:
    """Scene flow between all neighbouring frames; `range_share` is relative to the width. A single frame has no flow."""
    views = [RgbdFrame(rgb, depth_m, clip.K) for rgb, depth_m in zip(clip.rgb, clip.depth_m, strict=True)]
    found = [between(a, b) for a, b in pairwise(views)]
    size = clip.label.shape
    flow_m = np.stack([m for m, _ in found]) if found else np.zeros((0, *size, 3))
    flow_px = np.stack([px for _, px in found]) if found else np.zeros((0, *size, 2))
    shown, still = RANGES[colour](flow_m, range_m)
    shown_px, still_px = RANGES[colour](np.pad(flow_px, ((0, 0),) * 3 + ((0, 1),)), range_share * size[1])
    return SceneFlow(clip.name, flow_m.astype(np.float16), flow_px.astype(np.float16), shown, shown_px,
                     np.concatenate([still, still_px]))
