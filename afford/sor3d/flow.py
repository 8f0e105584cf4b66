"""Motion found against true motion, as sums that add up, and their ratio over a set."""

from __future__ import annotations

from collections.abc import Sequence

from afford.metrics.scene_flow import end_point_error
from schemas.interaction import InteractionTruth
from schemas.interaction_scores import FlowScore
from schemas.scene_flow import SceneFlow


def score(flow: SceneFlow, plain: SceneFlow, truth: InteractionTruth) -> FlowScore:
    """Of one sequence. ValueError when a flow is another's."""
    if not flow.name == plain.name == truth.name or not flow.flow_m.shape == plain.flow_m.shape == truth.flow_m.shape:
        raise ValueError(f"{truth.name}: expected two scene flows of this sequence with motion {truth.flow_m.shape}, got "
                         f"{flow.name} {flow.flow_m.shape} and {plain.name} {plain.flow_m.shape}")
    pixels = int(truth.valid.sum())
    if not pixels:
        return FlowScore(truth.name, 0, 0, 0.0, 0.0, 0.0, 0.0)
    ours, theirs = (end_point_error(one.flow_m, truth.flow_m, truth.valid) for one in (flow, plain))
    moving = round(ours.moving_share * pixels)
    sums = [value for one in (ours, theirs) for value in (one.all * pixels, one.moving * moving if moving else 0.0)]
    return FlowScore(truth.name, pixels, moving, *sums)


def figures(scores: Sequence[FlowScore]) -> dict[str, float]:
    """Means over all pixels of a set, in mm, and the share of the error of differencing; without what does not apply."""
    pixels, moving = sum(one.pixels for one in scores), sum(one.moving for one in scores)
    out: dict[str, float] = {}
    for count, suffix, ours, theirs in ((pixels, "", sum(one.error_m for one in scores), sum(one.plain_m for one in scores)),
                                        (moving, "_moving", sum(one.error_moving_m for one in scores),
                                         sum(one.plain_moving_m for one in scores))):  # fmt: skip
        if count and theirs > 0:
            out |= {f"flow.epe_ratio{suffix}": ours / theirs, f"flow.epe{suffix}_mm": 1e3 * ours / count,
                    f"flow.difference_epe{suffix}_mm": 1e3 * theirs / count}  # fmt: skip
    return out
