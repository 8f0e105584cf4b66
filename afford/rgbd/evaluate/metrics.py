"""Measures of SOR3D-AFF: IoU and F by category over all pixels of a set, and the paper's weighted mean; and those of the released
code, which differ.

Labels are (n, h, w) of indices in AFFORDANCES, BACKGROUND elsewhere. A category that neither occurs nor is found has no score: NaN,
and no say in a mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.interaction import AFFORDANCES, BACKGROUND

WEIGHTS = {"grasp": 0.2, "lift": 0.2, "push": 0.1}
"""of the weighted F; the paper says grasp 0.2, lift 0.2, push 0.1"""
OTHER_WEIGHT = 0.083
"""of every other category; all nine sum to 0.998, and the weighted mean divides by the sum of those that have a score"""
CODE_CONFIDENCE = 0.75
"""the released code's threshold on confidences"""


@dataclass(frozen=True)
class Counts:
    """Pixels of each category over a set; they add up."""

    hit: np.ndarray
    """(9,) int64 found and true"""
    found: np.ndarray
    """(9,) int64"""
    true: np.ndarray
    """(9,) int64"""

    def __add__(self, other: Counts) -> Counts:
        return Counts(self.hit + other.hit, self.found + other.found, self.true + other.true)


def counts(found: np.ndarray, truth: np.ndarray) -> Counts:
    """Of labels of one shape."""
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
    """Over the categories that have a score; NaN when none has."""
    known = ~np.isnan(scores)
    return float(scores[known].mean()) if known.any() else float("nan")


def weighted(scores: np.ndarray) -> float:
    """The paper's weighted mean of (9,) scores, over the categories that have one."""
    weight = np.array([WEIGHTS.get(name, OTHER_WEIGHT) for name in AFFORDANCES])
    known = ~np.isnan(scores)
    return float((scores[known] * weight[known]).sum() / weight[known].sum()) if known.any() else float("nan")


def summary(of: Counts, beta: float = 1.0) -> dict[str, float]:
    """iou, f and fw of a set, and iou.<category>, f.<category> of those that have a score."""
    each = {"iou": iou(of), "f": f_beta(of, beta)}
    named = {f"{key}.{name}": float(score) for key, scores in each.items() for name, score in zip(AFFORDANCES, scores, strict=True)
             if not np.isnan(score)}  # fmt: skip
    return {"iou": mean(each["iou"]), "f": mean(each["f"]), "fw": weighted(each["f"]), **named}


def code_jaccard(found: np.ndarray, truth: np.ndarray) -> float:
    """What the released code calls Jaccard: scikit-learn's of flattened labels, which for several classes was the share of pixels
    that agree, background and all.
    """
    return float((found == truth).mean())


def code_f1(confidence: np.ndarray, truth: np.ndarray) -> float:
    """What the released code prints as F1: one minus the F1 of what has a confidence above 0.75 (of any affordance) against what is
    not background. `confidence` is (10, h, w), `truth` (h, w) one sequence's. 1 when nothing agrees.
    """
    affording = np.arange(len(confidence)) != BACKGROUND
    said, true = (confidence[affording].max(0) > CODE_CONFIDENCE), truth != BACKGROUND
    total = np.count_nonzero(said) + np.count_nonzero(true)
    return 1.0 - (2.0 * np.count_nonzero(said & true) / total if total else 0.0)


def _share(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.divide(part, whole, out=np.full(len(whole), np.nan), where=whole > 0)
