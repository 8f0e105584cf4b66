"""Baseline scene flow: optical flow, and the difference of the measured depth at its two ends."""

from __future__ import annotations

import numpy as np

from afford.common.optical_flow import flow_between
from afford.rgbd.scene_flow.clip import RgbdFrame, lift, warp


def between(a: RgbdFrame, b: RgbdFrame, params: None) -> tuple[np.ndarray, np.ndarray]:
    """Motion from `a` to `b`: in space (h, w, 3) float32 in m, on the image (h, w, 2) float32 in px.

    A hole of `b` gets the depth of `a` at that pixel; a hole of `a` has no motion in space.
    """
    flow_px = flow_between(a.grey, b.grey)
    later_m = warp(b.depth_m, flow_px, nearest=True)
    change_m = np.where((later_m > 0) & (a.depth_m > 0), later_m - a.depth_m, np.float32(0))
    return lift(flow_px, a.depth_m, change_m, a.K), flow_px
