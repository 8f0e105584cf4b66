"""Measurements of n worlds that rewards and metrics are computed from, and the metrics of an episode.

Success is the paper's. Both readings of the paper's affordance score (AS) are reported, contacts of the whole hand, and depths.
Negative parts are judged by the truth, whatever N_t a policy was shown. All but `report` also takes tensors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from afford.common.arrays import mapped, namespace, number, taken, to_numpy
from afford.grasping.env.scenery import SAFE_M, EpisodeFrame, Scenery
from afford.grasping.sim.engine import State

TOUCH_N = 0.01
"""force from which a contact counts as a touch"""
GOAL_M = 0.05
"""success radius: the object is at its goal within this distance"""
FAR_M = 10.0
"""coordinate along all axes of points that do not count"""


@dataclass(frozen=True, eq=False)
class Measures:
    """Measurements of n worlds at one step; f fingers, thumb first."""

    palm_m: np.ndarray
    """(n,) from the middle of the palm to the object's centre of mass"""
    tips_m: np.ndarray
    """(n, f) from each fingertip to the nearest point of the object's surface"""
    allowed_m: np.ndarray
    """(n, f) from each fingertip to the nearest allowed point, one that is farther than 2 cm from all negative points"""
    positive_m: np.ndarray
    """(n, f) from each fingertip to the nearest positive point; 0 where no such points are known"""
    tips_centre_m: np.ndarray
    """(n, f) from each fingertip to the object's centre of mass"""
    goal_m: np.ndarray
    """(n,) from the object's centre of mass to its goal"""
    height_m: np.ndarray
    """(n,) of the object's centre of mass above the table"""
    N_m: np.ndarray
    """(n, f) from each fingertip to the nearest point of N_t; infinite without such points"""
    N_true_m: np.ndarray
    """(n, f) the same for the true negative points"""
    force_held: np.ndarray
    """(n, f + 1) N of each finger, and last of the rest of the hand, on parts that are not negative in truth"""
    force_negative: np.ndarray
    """(n, f + 1) N on parts that are negative in truth"""
    force_told: np.ndarray
    """(n, f + 1) N on parts that are negative by N_t"""
    penetration_m: np.ndarray
    """(n,) depth of the deepest contact of hand and object"""
    away_m: np.ndarray
    """(n,) distance along the table of the object's centre of mass from its place at rest"""
    action: np.ndarray
    """(n, m) last action"""

    @property
    def touching(self) -> np.ndarray:
        """(n, f + 1) bool, each finger and the palm touch the object."""
        found: np.ndarray = self.force_held + self.force_negative > TOUCH_N
        return found

    @property
    def gripped(self) -> np.ndarray:
        """(n,) bool, two or more of the fingers and the palm touch the object."""
        found: np.ndarray = self.touching.sum(axis=1) >= 2
        return found


def measure(scenery: Scenery, episode: EpisodeFrame, state: State, action: np.ndarray) -> Measures:
    """Compute all measurements of a state."""
    xp, norm = namespace(state.tips), namespace(state.tips).linalg.norm
    centre = scenery.centre(state)
    points = scenery.points(state)
    on_N = xp.einsum("nfp,np->nf", state.force, number(scenery.negative))
    return Measures(
        palm_m=norm(scenery.palm(state) - centre, axis=1),
        tips_m=nearest(state.tips, points)[0],
        allowed_m=nearest(state.tips, xp.where(scenery.allowed[:, :, None], points, FAR_M))[0],
        positive_m=scenery.any_positive[:, None] * nearest(state.tips, scenery.positive_points(state))[0],
        tips_centre_m=norm(state.tips - centre[:, None], axis=2),
        goal_m=norm(centre - episode.goal, axis=1),
        height_m=centre[:, 2],
        N_m=_to(state.tips, scenery.negative_points(state), scenery.any_negative),
        N_true_m=_to(state.tips, scenery.true_points(state), scenery.any_true),
        force_held=state.force.sum(axis=2) - on_N, force_negative=on_N,
        force_told=xp.einsum("nfp,np->nf", state.force, number(scenery.told)), penetration_m=xp.asarray(state.penetration_m),
        away_m=norm((centre - episode.origin)[:, :2], axis=1), action=action)  # fmt: skip


def nearest(spots: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Find the nearest of points (n, k, 3) to each of spots (n, f, 3): distances (n, f) and points (n, f, 3)."""
    squared = (spots**2).sum(2)[:, :, None] + (points**2).sum(2)[:, None] - 2 * spots @ points.swapaxes(1, 2)
    chosen = squared.argmin(axis=2)
    found = taken(points, chosen[:, :, None], axis=1)
    return namespace(spots).linalg.norm(spots - found, axis=2), found


def _to(spots: np.ndarray, points: np.ndarray, there: np.ndarray) -> np.ndarray:
    """(n, f) distances of spots to points, infinite in worlds without points."""
    found: np.ndarray = namespace(spots).where(there[:, None], nearest(spots, points)[0], np.inf)
    return found


def as_safe_count(N_m: np.ndarray) -> np.ndarray:
    """Affordance score as the paper words it: (n, f) distances to N_t -> (n,) number of safe fingertips, 0..f; more is better."""
    return np.asarray((N_m > SAFE_M).sum(axis=-1))


def as_violation_pct(N_m: np.ndarray) -> np.ndarray:
    """Affordance score that fits the paper's tables: (n, f) distances -> (n,) percent of unsafe fingertips; less is better."""
    return np.asarray(100.0 * (N_m <= SAFE_M).mean(axis=-1))


class EpisodeLog:
    """Record of n running episodes, for their metrics. `copy.deepcopy` makes an independent copy."""

    def __init__(self, n: int, steps: int, own: Callable[[np.ndarray], Any] = np.asarray) -> None:
        """Begin a record; `own` converts its arrays (arrays.py)."""
        self.success = own(np.zeros(n, bool))
        self.negative = own(np.zeros(n, bool))
        self.unsafe = own(np.zeros(n, bool))
        self.depth_m = own(np.full((n, steps), np.nan))
        self._rows = own(np.arange(n))

    def clear(self, which: np.ndarray) -> None:
        """Forget the episodes of worlds `which`."""
        self.success[which] = self.negative[which] = self.unsafe[which] = False
        self.depth_m[which] = np.nan

    def record(self, m: Measures, step: np.ndarray) -> None:
        """Add the measurements after steps of numbers (n,)."""
        self.success |= m.goal_m < GOAL_M
        self.negative |= (m.force_negative > TOUCH_N).any(axis=1)
        self.unsafe |= (m.N_true_m <= SAFE_M).any(axis=1)
        before = self.depth_m[self._rows, step]
        self.depth_m[self._rows, step] = namespace(before).where(m.touching.any(axis=1), m.penetration_m, before)

    def report(self, m: Measures) -> dict[str, np.ndarray]:
        """(n,) figures (METRICS) of episodes that end with these measurements, as arrays of numpy."""
        m = mapped(m, to_numpy)
        success, negative, unsafe, depth_m = map(to_numpy, (self.success, self.negative, self.unsafe, self.depth_m))
        return {
            "success": success.astype(float), "held": ((m.goal_m < GOAL_M) & m.touching.any(axis=1)).astype(float),
            "as_violation_pct": as_violation_pct(m.N_true_m), "as_safe_count": as_safe_count(m.N_true_m).astype(float),
            "as_any_step": unsafe.astype(float),
            "negative_contact_end": (m.force_negative > TOUCH_N).any(axis=1).astype(float),
            "negative_contact_any": negative.astype(float),
            "penetration_median_m": _quantile(depth_m, 50), "penetration_p95_m": _quantile(depth_m, 95),
            "goal_m": m.goal_m}  # fmt: skip


METRICS: Mapping[str, str] = {
    "success": "the object was within 5 cm of its goal at some step (the paper's, sticky)",
    "held": "the object is within 5 cm of its goal at the last step, and the hand touches it",
    "as_violation_pct": "percent of fingertips within 2 cm of a negative point at the last step",
    "as_safe_count": "fingertips farther than 2 cm from every negative point at the last step",
    "as_any_step": "a fingertip came within 2 cm of a negative point at some step",
    "negative_contact_end": "a finger or the palm presses on a negative part at the last step",
    "negative_contact_any": "a finger or the palm pressed on a negative part at some step",
    "penetration_median_m": "median depth of the deepest contact, over steps in which hand and object touch; NaN without any",
    "penetration_p95_m": "95th percentile of the same depth",
    "goal_m": "distance of the object from its goal at the last step, m",
}
"""name -> meaning of each figure of a report"""


def _quantile(depth_m: np.ndarray, percent: float) -> np.ndarray:
    """(n,) percentile over the recorded steps; NaN without any."""
    return np.array([np.percentile(row[~np.isnan(row)], percent) if (~np.isnan(row)).any() else np.nan for row in depth_m])
