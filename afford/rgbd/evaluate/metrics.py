"""Metrics of SOR3D-AFF: IoU and F per category over all pixels of a set, their intervals, and the released code's variants.

Labels are (n, h, w) of indices in AFFORDANCES, BACKGROUND elsewhere. A category that neither occurs nor is predicted has no score:
it is NaN and excluded from means.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from schemas.interaction import AFFORDANCES, BACKGROUND, InteractionScores

WEIGHTS = {"grasp": 0.2, "lift": 0.2, "push": 0.1}
"""weights of the weighted F; the paper says grasp 0.2, lift 0.2, push 0.1"""
OTHER_WEIGHT = 0.083
"""weight of every other category; all nine sum to 0.998, and the weighted mean divides by the sum of those that have a score"""
CODE_CONFIDENCE = 0.75
"""the released code's threshold on confidences"""


@dataclass(frozen=True)
class Counts:
    """Pixel counts of each category over a set; counts of two sets add up."""

    hit: np.ndarray
    """(9,) int64 predicted and true"""
    found: np.ndarray
    """(9,) int64 predicted"""
    true: np.ndarray
    """(9,) int64 true"""

    def __add__(self, other: Counts) -> Counts:
        return Counts(self.hit + other.hit, self.found + other.found, self.true + other.true)


def counts(found: np.ndarray, truth: np.ndarray) -> Counts:
    """Count pixels of predicted and true labels of one shape."""
    kinds = range(len(AFFORDANCES))
    return Counts(*(np.array([np.count_nonzero(pick(kind)) for kind in kinds], np.int64) for pick in (
        lambda kind: (found == kind) & (truth == kind), lambda kind: found == kind, lambda kind: truth == kind)))  # fmt: skip


def iou(of: Counts) -> np.ndarray:
    """Intersection over union of each category, (9,) float64."""
    return _share(of.hit, of.found + of.true - of.hit)


def f_beta(of: Counts, beta: float = 1.0) -> np.ndarray:
    """F of each category, (9,): (1 + b^2) P R / (b^2 P + R), written in counts. The paper has F1, b = 1."""
    square = beta * beta
    return _share((1 + square) * of.hit, square * of.true + of.found)


def mean(scores: np.ndarray) -> float:
    """Mean over the categories that have a score; NaN without any."""
    known = ~np.isnan(scores)
    return float(scores[known].mean()) if known.any() else float("nan")


def weighted(scores: np.ndarray) -> float:
    """The paper's weighted mean of (9,) scores, over the categories that have a score."""
    weight = np.array([WEIGHTS.get(name, OTHER_WEIGHT) for name in AFFORDANCES])
    known = ~np.isnan(scores)
    return float((scores[known] * weight[known]).sum() / weight[known].sum()) if known.any() else float("nan")


def summary(of: Counts, beta: float = 1.0) -> dict[str, float]:
    """iou, f and fw of a set, and iou.<category>, f.<category> of the categories that have a score."""
    each = {"iou": iou(of), "f": f_beta(of, beta)}
    named = {f"{key}.{name}": float(score) for key, scores in each.items() for name, score in zip(AFFORDANCES, scores, strict=True)
             if not np.isnan(score)}  # fmt: skip
    return {"iou": mean(each["iou"]), "f": mean(each["f"]), "fw": weighted(each["f"]), **named}


def code_jaccard(found: np.ndarray, truth: np.ndarray) -> float:
    """Jaccard as in the released code: the share of all pixels, background included, with the right label.

    The released code calls scikit-learn's function on flattened labels; for several classes that function returned this
    accuracy.
    """
    return float((found == truth).mean())


def code_f1(confidence: np.ndarray, truth: np.ndarray) -> float:
    """F1 as in the released code: one minus the F1 of confident pixels against pixels that are not background.

    `confidence` is (10, h, w), `truth` (h, w) of one sequence. A pixel is confident when any affordance exceeds 0.75. The value
    is 1 when nothing agrees.
    """
    affording = np.arange(len(confidence)) != BACKGROUND
    confident, true = (confidence[affording].max(0) > CODE_CONFIDENCE), truth != BACKGROUND
    total = np.count_nonzero(confident) + np.count_nonzero(true)
    return 1.0 - (2.0 * np.count_nonzero(confident & true) / total if total else 0.0)


def _share(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.divide(part, whole, out=np.full(len(whole), np.nan), where=whole > 0)


SHARE = 0.95
"""coverage of an interval"""
CODE = ("code_jaccard", "code_f1")
"""metrics of the released code: computed per sequence, then averaged"""
POOLED: dict[str, Callable[[Counts], float]] = {
    "iou": lambda of: mean(iou(of)),
    "f": lambda of: mean(f_beta(of)),
    "fw": lambda of: weighted(f_beta(of)),
}
"""metrics that have an interval"""


def figures(one: InteractionScores) -> dict[str, float]:
    """Compute all figures of a set of sequences by name; those that do not apply are left out.

    <mode>.iou, .f, .fw, <mode>.iou.<category>, <mode>.f.<category>, <mode>.region_iou, <mode>.code_jaccard, <mode>.code_f1;
    action.accuracy, action.accuracy.<category> (of video) and static.action.
    """
    out = {f"{mode}.{name}": value for mode in one.mode for name, value in summary(pooled_counts(one, mode)).items()}
    out |= {f"{mode}.region_iou": mean(iou(region_counts(one, mode))) for mode in one.mode}
    out |= {f"{mode}.{name}": float(value) for mode, means in zip(one.mode, one.code.mean(0), strict=True)
            for name, value in zip(CODE, means, strict=True)}  # fmt: skip
    if "static" in one.mode:
        out["static.action"] = float(correct_actions(one, "static").mean())
    if "video" in one.mode:
        found, used = correct_actions(one, "video"), np.array(one.affordance)
        out["action.accuracy"] = float(found.mean())
        out |= {f"action.accuracy.{name}": float(found[used == name].mean()) for name in AFFORDANCES if (used == name).any()}
    return {name: value for name, value in out.items() if not math.isnan(value)}


def pooled_counts(one: InteractionScores, mode: str) -> Counts:
    """Pixel counts of all sequences."""
    return Counts(*one.pixels[:, one.mode.index(mode)].sum(0))


def region_counts(one: InteractionScores, mode: str) -> Counts:
    """Pixel counts of any affordance by the true affordance: where something is afforded, whatever its category."""
    at = one.mode.index(mode)
    used = np.array([AFFORDANCES.index(name) for name in one.affordance])
    each = one.region[:, at], one.pixels[:, at, 1].sum(-1), one.pixels[:, at, 2].sum(-1)
    return Counts(*(np.array([of[used == kind].sum() for kind in range(len(AFFORDANCES))]) for of in each))


def correct_actions(one: InteractionScores, mode: str) -> np.ndarray:
    """(n,) bool: sequences whose most probable action is the true one."""
    true = np.array([AFFORDANCES.index(name) for name in one.affordance])
    found: np.ndarray = one.action[:, one.mode.index(mode)].argmax(-1) == true
    return found


def intervals(one: InteractionScores, resamples: int, seed: int) -> dict[str, float]:
    """Bootstrap over sequences: <mode>.<figure>.low and .high, and those of action.accuracy."""
    count = len(one.clip)
    times = np.random.default_rng(seed).multinomial(count, np.full(count, 1 / count), size=resamples)
    drawn = {"action.accuracy": times @ correct_actions(one, "video") / count} if "video" in one.mode else {}
    for m, mode in enumerate(one.mode):
        sums = np.tensordot(times, one.pixels[:, m], 1)
        drawn |= {f"{mode}.{name}": np.array([figure(Counts(*of)) for of in sums]) for name, figure in POOLED.items()}
    edges = {name: np.nanquantile(values, [(1 - SHARE) / 2, (1 + SHARE) / 2]) for name, values in drawn.items()
             if not np.isnan(values).all()}  # fmt: skip
    return {f"{name}.{end}": float(value) for name, ends in edges.items() for end, value in zip(("low", "high"), ends, strict=True)}
