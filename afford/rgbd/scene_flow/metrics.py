"""End-point error of scene flow, in space and on the image, pooled over a set."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from schemas.interaction import FlowScore, InteractionTruth, SceneFlow

MOVES_M = 1e-3
"""motion per frame below this counts as rest"""


class EndPointError(NamedTuple):
    """Mean end-point error in the unit of the motion."""

    all: float
    """over every pixel with ground truth"""
    moving: float
    """over the moving pixels among them; NaN without any"""
    moving_share: float
    """share of the moving pixels among those with ground truth"""


def moving_mask(truth_m: np.ndarray) -> np.ndarray:
    """Moving pixels, (...) bool, of true motion (..., 3) in m per frame."""
    found: np.ndarray = np.linalg.norm(truth_m, axis=-1) > MOVES_M
    return found


def end_point_error(found: np.ndarray, truth: np.ndarray, known: np.ndarray, moving: np.ndarray) -> EndPointError:
    """End-point error of motion (..., k) per frame; `known` and `moving` are (...) bool masks. NaN without ground truth."""
    miss = np.linalg.norm(found.astype(np.float64) - truth, axis=-1)
    return EndPointError(_mean(miss[known]), _mean(miss[known & moving]), _mean(moving[known].astype(float)))


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else float("nan")


def score_flow(flow: SceneFlow, plain: SceneFlow, truth: InteractionTruth) -> FlowScore:
    """Score the scene flow of one sequence and that of a baseline. ValueError when a flow is of another sequence."""
    if not flow.name == plain.name == truth.name or not flow.flow_m.shape == plain.flow_m.shape == truth.flow_m.shape:
        raise ValueError(f"{truth.name}: expected two scene flows of this sequence with motion {truth.flow_m.shape}, got "
                         f"{flow.name} {flow.flow_m.shape} and {plain.name} {plain.flow_m.shape}")
    moving = moving_mask(truth.flow_m)
    counts = int(truth.valid.sum()), int((truth.valid & moving).sum())
    in_space = [_error_sums(one.flow_m, truth.flow_m, truth.valid, moving) for one in (flow, plain)]
    on_image = [_error_sums(one.flow_px, truth.flow_px, truth.valid, moving) for one in (flow, plain)]
    return FlowScore(truth.name, *counts, *(value for sums in (*in_space, *on_image) for value in sums))


def _error_sums(found: np.ndarray, truth: np.ndarray, known: np.ndarray, moving: np.ndarray) -> tuple[float, float]:
    """Sums of end-point errors over known pixels, and over the moving ones among them."""
    error = end_point_error(found, truth, known, moving)
    counts = int(known.sum()), int((known & moving).sum())
    every, some = (mean * count if count else 0.0 for mean, count in zip(error[:2], counts, strict=True))
    return every, some


def flow_figures(scores: Sequence[FlowScore]) -> dict[str, float]:
    """Mean errors over all pixels of a set, in mm and in px on the image, and the ratio to the baseline's error in mm.

    Figures that do not apply are left out.
    """
    out: dict[str, float] = {}
    for count, suffix, part in ((_total(scores, "pixels"), "", ""), (_total(scores, "moving"), "_moving", "moving_")):
        ours, theirs = _total(scores, f"error_{part}m"), _total(scores, f"plain_{part}m")
        if count and theirs > 0:
            out |= {f"flow.epe_ratio{suffix}": ours / theirs, f"flow.epe{suffix}_mm": 1e3 * ours / count,
                    f"flow.difference_epe{suffix}_mm": 1e3 * theirs / count}  # fmt: skip
        if count:
            out |= {f"flow.epe_px{suffix}": _total(scores, f"error_{part}px") / count,
                    f"flow.difference_epe_px{suffix}": _total(scores, f"plain_{part}px") / count}  # fmt: skip
    return out


def _total(scores: Sequence[FlowScore], field: str) -> float:
    return float(sum(getattr(one, field) for one in scores))
