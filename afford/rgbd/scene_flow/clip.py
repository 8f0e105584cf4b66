"""The scene flow of a whole clip, and its colours."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from afford.rgbd.scene_flow import colours
from afford.rgbd.scene_flow.view import View
from schemas.interaction import InteractionClip, SceneFlow

Estimate = Callable[[View, View], tuple[np.ndarray, np.ndarray]]
"""a backend with its own parameters, see `Between`"""
RANGES = {"fixed": colours.fixed, "clip": colours.of_clip}


def scene_flow(clip: InteractionClip, between: Estimate, colour: str, range_m: float,
               range_share: float) -> SceneFlow:
    """Every pair of neighbouring frames; `range_share` is of the width. A clip of one frame has no flow."""
    views = [View(rgb, depth_m, clip.K) for rgb, depth_m in zip(clip.rgb, clip.depth_m, strict=True)]
    found = [between(a, b) for a, b in pairwise(views)]
    size = clip.label.shape
    flow_m = np.stack([m for m, _ in found]) if found else np.zeros((0, *size, 3))
    flow_px = np.stack([px for _, px in found]) if found else np.zeros((0, *size, 2))
    shown, still = RANGES[colour](flow_m, range_m)
    shown_px, still_px = RANGES[colour](np.pad(flow_px, ((0, 0),) * 3 + ((0, 1),)), range_share * size[1])
    return SceneFlow(clip.name, flow_m.astype(np.float16), flow_px.astype(np.float16), shown, shown_px,
                     np.concatenate([still, still_px]))
