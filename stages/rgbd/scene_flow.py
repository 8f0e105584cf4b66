"""Estimate the scene flow of an RGB-D clip: motion of everything visible, in space and on the image.

Reads   InteractionClip
Writes  SceneFlow: metres and pixels per frame, and both as colours
Method  optical flow (DIS, also from a search of large shifts) and measured depth, smoothed within surfaces by a fast global
        smoother (weighted least squares) from pixels where both directions agree; holes filled; each surface takes the
        hypothesis that explains the next frame best, and rest unless motion wins by a margin. Deterministic.
        backend `difference`: optical flow and the difference of depths only
Fails   when the clip is smaller than 32 px, a parameter is not positive, or the colour coding is unknown
Paper   SOR3D-AFF, 3-D flow (there PD-Flow on pairs of frames, each axis normalised to 0..255); the camera stands still, as there
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.rgbd.scene_flow import Regularised
from schemas.interaction import InteractionClip, SceneFlow

LIBRARIES = ("numpy", "opencv-python-headless")
BACKEND_LIBRARIES = {"regularised": ("numba",)}
THREADS = 1
MEMORY_GIB = 0.5
TIMEOUT_S = 86400.0  # reports no progress, whatever the length of the recording
SMALLEST_PX = 32

BACKENDS = {
    "regularised": "afford.rgbd.scene_flow.regularised:between",
    "difference": "afford.rgbd.scene_flow.difference:between",
}


@dataclass(frozen=True)
class Params:
    """Parameters of `scene_flow`."""

    backend: str = "regularised"
    """regularised, or difference: optical flow with the difference of depths, as a baseline"""
    colour: str = "fixed"
    """fixed: no motion has the same colour in every clip; clip: minimum to maximum motion of each clip, as in the paper"""
    range_m: float = 0.05
    """fixed: motion in metres per frame at full colour"""
    range_share: float = 0.08
    """fixed: motion on the image per frame at full colour, as a share of the width"""
    regularised: Regularised = Regularised()
    """parameters of regularised"""


def run(clip: InteractionClip, params: Params) -> SceneFlow:
    """Estimate the flow between all neighbouring frames."""
    from functools import partial

    from afford.common.registry import block, load
    from afford.rgbd.scene_flow.clip import scene_flow

    for name in ("range_m", "range_share"):
        if getattr(params, name) <= 0:
            raise ValueError(f"scene_flow.{name}: expected more than 0, got {getattr(params, name)}")
    if params.colour not in ("fixed", "clip"):
        raise ValueError(f"scene_flow.colour: expected fixed or clip, got {params.colour!r}")
    if min(clip.label.shape) < SMALLEST_PX:
        raise ValueError(f"{clip.name}: expected frames of at least {SMALLEST_PX} x {SMALLEST_PX} px, got {clip.label.shape}; "
                         "read it at a larger size")
    between = partial(load(BACKENDS, params.backend), params=block(params, params.backend))
    return scene_flow(clip, between, params.colour, params.range_m, params.range_share)
