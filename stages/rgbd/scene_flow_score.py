"""Score scene flow, and the baseline of optical flow with depth differences, against the truth of a rendered sequence.

Reads   SceneFlow twice, InteractionTruth
Writes  FlowScore: sums of end-point errors of both over all pixels with a surface and over the moving ones, in m and in px
Method  length of the difference of motion in space, as Vedula et al. (1999) measure it, and of motion on the image; sums, so that
        sequences can be pooled
Fails   when a flow is of another sequence
Paper   SOR3D-AFF, 3-D flow (not measured there)
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.interaction import FlowScore, InteractionTruth, SceneFlow

LIBRARIES = ("numpy",)
THREADS = 1
MEMORY_GIB = 0.3


@dataclass(frozen=True)
class Params:
    """Parameters of `scene_flow_score`: none."""


def run(flow: SceneFlow, plain: SceneFlow, truth: InteractionTruth, params: Params) -> FlowScore:
    """Score one sequence."""
    from afford.rgbd.scene_flow.metrics import score_flow

    return score_flow(flow, plain, truth)
