"""Scores of sequences -> figures of a set: pixels pooled, actions counted, intervals by resampling sequences."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from afford.rgbd.evaluate import metrics as measures
from afford.rgbd.evaluate.metrics import Counts
from schemas.interaction import AFFORDANCES, InteractionScores

SHARE = 0.95
"""of the resampled figures that lie in an interval"""
CODE = ("code_jaccard", "code_f1")
"""those of the released code: of each sequence, then their mean"""
POOLED: dict[str, Callable[[Counts], float]] = {
    "iou": lambda of: measures.mean(measures.iou(of)),
    "f": lambda of: measures.mean(measures.f_beta(of)),
    "fw": lambda of: measures.weighted(measures.f_beta(of)),
}
"""those that have an interval"""


def figures(one: InteractionScores) -> dict[str, float]:
    """<mode>.iou, .f, .fw, <mode>.iou.<category>, <mode>.f.<category>, <mode>.region_iou, <mode>.code_jaccard, <mode>.code_f1;
    action.accuracy, action.accuracy.<category> (of video) and static.action; without what does not apply.
    """
    out = {f"{mode}.{name}": value for mode in one.mode for name, value in measures.summary(pooled(one, mode)).items()}
    out |= {f"{mode}.region_iou": measures.mean(measures.iou(regions(one, mode))) for mode in one.mode}
    out |= {f"{mode}.{name}": float(value) for mode, means in zip(one.mode, one.code.mean(0), strict=True)
            for name, value in zip(CODE, means, strict=True)}  # fmt: skip
    if "static" in one.mode:
        out["static.action"] = float(right(one, "static").mean())
    if "video" in one.mode:
        found, used = right(one, "video"), np.array(one.affordance)
        out["action.accuracy"] = float(found.mean())
        out |= {f"action.accuracy.{name}": float(found[used == name].mean()) for name in AFFORDANCES if (used == name).any()}
    return {name: value for name, value in out.items() if not math.isnan(value)}


def pooled(one: InteractionScores, mode: str) -> Counts:
    """Pixels of all sequences."""
    return Counts(*one.pixels[:, one.mode.index(mode)].sum(0))


def regions(one: InteractionScores, mode: str) -> Counts:
    """Pixels of any affordance, by what is used in truth: where, whatever it is called."""
    at = one.mode.index(mode)
    used = np.array([AFFORDANCES.index(name) for name in one.affordance])
    each = one.region[:, at], one.pixels[:, at, 1].sum(-1), one.pixels[:, at, 2].sum(-1)
    return Counts(*(np.array([of[used == kind].sum() for kind in range(len(AFFORDANCES))]) for of in each))


def right(one: InteractionScores, mode: str) -> np.ndarray:
    """(n,) bool: whose most probable action is the true one."""
    true = np.array([AFFORDANCES.index(name) for name in one.affordance])
    found: np.ndarray = one.action[:, one.mode.index(mode)].argmax(-1) == true
    return found


def intervals(one: InteractionScores, resamples: int, seed: int) -> dict[str, float]:
    """<mode>.<figure>.low and .high, and those of action.accuracy: sequences are drawn again, whole."""
    count = len(one.clip)
    times = np.random.default_rng(seed).multinomial(count, np.full(count, 1 / count), size=resamples)
    drawn = {"action.accuracy": times @ right(one, "video") / count} if "video" in one.mode else {}
    for m, mode in enumerate(one.mode):
        sums = np.tensordot(times, one.pixels[:, m], 1)
        drawn |= {f"{mode}.{name}": np.array([figure(Counts(*of)) for of in sums]) for name, figure in POOLED.items()}
    edges = {name: np.nanquantile(values, [(1 - SHARE) / 2, (1 + SHARE) / 2]) for name, values in drawn.items()
             if not np.isnan(values).all()}  # fmt: skip
    return {f"{name}.{end}": float(value) for name, ends in edges.items() for end, value in zip(("low", "high"), ends, strict=True)}
