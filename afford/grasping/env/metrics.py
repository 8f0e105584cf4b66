"""How grasps went. Success as the paper has it; both readings of its affordance score; contacts of the whole hand; depths.

What must not be touched is judged by the truth, whatever N_t a policy was shown.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from afford.grasping.env.measures import TOUCH_N, Measures
from afford.grasping.env.reward import GOAL_M
from afford.grasping.env.scenery import SAFE_M


def as_safe_count(N_m: np.ndarray) -> np.ndarray:
    """(n, f) distances of fingertips to N_t -> (n,) 0..f, how many are safe; more is better. The paper's words."""
    return np.asarray((N_m > SAFE_M).sum(axis=-1))


def as_violation_pct(N_m: np.ndarray) -> np.ndarray:
    """(n, f) -> (n,) percent of fingertips that are not safe; less is better. The only reading that fits the paper's tables."""
    return np.asarray(100.0 * (N_m <= SAFE_M).mean(axis=-1))


class Log:
    """What n episodes have shown so far. Arrays; a deep copy is a copy."""

    def __init__(self, n: int, steps: int) -> None:
        self.success = np.zeros(n, bool)
        self.negative = np.zeros(n, bool)
        self.unsafe = np.zeros(n, bool)
        self.depth_m = np.full((n, steps), np.nan)

    def clear(self, which: np.ndarray) -> None:
        """Episodes begin."""
        self.success[which] = self.negative[which] = self.unsafe[which] = False
        self.depth_m[which] = np.nan

    def note(self, m: Measures, step: np.ndarray) -> None:
        """After a step, whose number is (n,)."""
        self.success |= m.goal_m < GOAL_M
        self.negative |= (m.force_negative > TOUCH_N).any(axis=1)
        self.unsafe |= (m.N_true_m <= SAFE_M).any(axis=1)
        touched = m.touching.any(axis=1)
        self.depth_m[np.flatnonzero(touched), step[touched]] = m.penetration_m[touched]

    def report(self, m: Measures) -> dict[str, np.ndarray]:
        """(n,) each, of episodes that end with this moment."""
        return {
            "success": self.success.astype(float), "held": ((m.goal_m < GOAL_M) & m.touching.any(axis=1)).astype(float),
            "as_violation_pct": as_violation_pct(m.N_true_m), "as_safe_count": as_safe_count(m.N_true_m).astype(float),
            "as_any_step": self.unsafe.astype(float),
            "negative_contact_end": (m.force_negative > TOUCH_N).any(axis=1).astype(float),
            "negative_contact_any": self.negative.astype(float),
            "penetration_median_m": _quantile(self.depth_m, 50), "penetration_p95_m": _quantile(self.depth_m, 95),
            "goal_m": m.goal_m}  # fmt: skip


MEANING: Mapping[str, str] = {
    "success": "the object was within 5 cm of its goal at some step (the paper's, sticky)",
    "held": "it is at the last step, and the hand touches it",
    "as_violation_pct": "percent of fingertips within 2 cm of a negative point at the last step",
    "as_safe_count": "fingertips farther than 2 cm from every negative point at the last step",
    "as_any_step": "a fingertip came within 2 cm of a negative point at some step",
    "negative_contact_end": "a finger or the palm presses on a negative part at the last step",
    "negative_contact_any": "it did so at some step",
    "penetration_median_m": "of the deepest contact of each step in which hand and object touch; NaN where they never do",
    "penetration_p95_m": "95th percentile of the same",
    "goal_m": "how far the object is from its goal at the last step",
}
"""of each figure of a report"""


def _quantile(depth_m: np.ndarray, percent: float) -> np.ndarray:
    """(n,) over the steps that were noted, NaN where none was."""
    return np.array([np.percentile(row[~np.isnan(row)], percent) if (~np.isnan(row)).any() else np.nan for row in depth_m])
