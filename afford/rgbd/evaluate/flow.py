"""Motion found against true motion, as sums that add up, and their ratio over a set."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from afford.rgbd.evaluate.flow_metrics import end_point_error, moves
from schemas.interaction import FlowScore, InteractionTruth, SceneFlow


def score(flow: SceneFlow, plain: SceneFlow, truth: InteractionTruth) -> FlowScore:
    """Of one sequence. ValueError when a flow is another's."""
    if not flow.name == plain.name == truth.name or not flow.flow_m.shape == plain.flow_m.shape == truth.flow_m.shape:
        raise ValueError(f"{truth.name}: expected two scene flows of this sequence with motion {truth.flow_m.shape}, got "
                         f"{flow.name} {flow.flow_m.shape} and {plain.name} {plain.flow_m.shape}")
    moving = moves(truth.flow_m)
    counts = int(truth.valid.sum()), int((truth.valid & moving).sum())
    in_space = [_sums(one.flow_m, truth.flow_m, truth.valid, moving) for one in (flow, plain)]
    on_image = [_sums(one.flow_px, truth.flow_px, truth.valid, moving) for one in (flow, plain)]
    return FlowScore(truth.name, *counts, *(value for sums in (*in_space, *on_image) for value in sums))


def _sums(found: np.ndarray, truth: np.ndarray, known: np.ndarray, moving: np.ndarray) -> tuple[float, float]:
    """Of end-point errors over known pixels, and over those of them that move."""
    error = end_point_error(found, truth, known, moving)
    counts = int(known.sum()), int((known & moving).sum())
    every, some = (mean * count if count else 0.0 for mean, count in zip(error[:2], counts, strict=True))
    return every, some


def figures(scores: Sequence[FlowScore]) -> dict[str, float]:
    """Means over all pixels of a set, in mm and on the image in px, and the share of the error of differencing in mm; without what
    does not apply.
    """
    out: dict[str, float] = {}
    for count, suffix, part in ((_sum(scores, "pixels"), "", ""), (_sum(scores, "moving"), "_moving", "moving_")):
        ours, theirs = _sum(scores, f"error_{part}m"), _sum(scores, f"plain_{part}m")
        if count and theirs > 0:
            out |= {f"flow.epe_ratio{suffix}": ours / theirs, f"flow.epe{suffix}_mm": 1e3 * ours / count,
                    f"flow.difference_epe{suffix}_mm": 1e3 * theirs / count}  # fmt: skip
        if count:
            out |= {f"flow.epe_px{suffix}": _sum(scores, f"error_{part}px") / count,
                    f"flow.difference_epe_px{suffix}": _sum(scores, f"plain_{part}px") / count}  # fmt: skip
    return out


def _sum(scores: Sequence[FlowScore], field: str) -> float:
    return float(sum(getattr(one, field) for one in scores))
