"""Rewards of imitation (AffordDex, HTI): how near a hand is to a reference, how calm.

`paper`: squared distances of both levels of every finger, and the power of all joints. `code`: what its code has, which takes mean
distances, not squared, and the wrist's pose and speeds as well.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

STRICT_M, LOOSE = 0.15, 1 / 0.7
"""largest mean error of a level in the end, and how much more is allowed in the beginning of a training"""
INSANE_M_S, INSANE_RAD_S = 100.0, 200.0
PATIENCE_S = 50 / 60
"""an episode cannot fail before"""


@dataclass(frozen=True, eq=False)
class Tracking:
    """How n hands are beside their references, f fingers."""

    level_1_m: np.ndarray
    """(n, f) distances of the joints where fingers leave the palm"""
    level_2_m: np.ndarray
    """(n, f) one phalanx further"""
    wrist_m: np.ndarray
    """(n,)"""
    wrist_rad: np.ndarray
    """(n,)"""
    linear_m_s: np.ndarray
    """(n, 3) palm's velocity less that of the reference"""
    angular_rad_s: np.ndarray
    """(n, 3)"""
    joints_rad_s: np.ndarray
    """(n, k) speeds of fingers' joints less those of the reference"""
    power_w: np.ndarray
    """(n,) sum of |torque x speed| of fingers' motors"""
    wrist_power_w: np.ndarray
    """(n,) the same of the wrist's"""


class Term(NamedTuple):
    """One reason for reward."""

    doc: str
    of: Callable[[Tracking], np.ndarray]
    """-> (n,) before its weight"""


TERMS: Mapping[str, Term] = {
    "fingers": Term("sum over fingers of exp(-50 d^2) of level 1 and exp(-40 d^2) of level 2",
                    lambda t: (np.exp(-50 * t.level_1_m**2) + np.exp(-40 * t.level_2_m**2)).sum(axis=1)),
    "smooth": Term("W, minus the sum of |torque x speed| of all motors", lambda t: -(t.power_w + t.wrist_power_w)),
    "level_1": Term("exp(-50 x mean distance) of level 1", lambda t: np.exp(-50 * t.level_1_m.mean(axis=1))),
    "level_2": Term("exp(-40 x mean distance) of level 2", lambda t: np.exp(-40 * t.level_2_m.mean(axis=1))),
    "wrist_place": Term("exp(-40 d) of the palm's place", lambda t: np.exp(-40 * t.wrist_m)),
    "wrist_turn": Term("exp(-angle) of the palm's rotation", lambda t: np.exp(-t.wrist_rad)),
    "wrist_linear": Term("exp(-mean |difference|) of the palm's velocity", lambda t: np.exp(-np.abs(t.linear_m_s).mean(axis=1))),
    "wrist_angular": Term("the same of its angular velocity", lambda t: np.exp(-np.abs(t.angular_rad_s).mean(axis=1))),
    "joint_speeds": Term("the same of the speeds of fingers' joints", lambda t: np.exp(-np.abs(t.joints_rad_s).mean(axis=1))),
    "calm": Term("exp(-10 W) of the fingers' motors", lambda t: np.exp(-10 * t.power_w)),
    "wrist_calm": Term("exp(-2 W) of the wrist's", lambda t: np.exp(-2 * t.wrist_power_w)),
}  # fmt: skip

REWARDS: Mapping[str, Mapping[str, float]] = {
    "paper": {"fingers": 0.8, "smooth": 0.05},
    "code": {"level_1": 0.6, "level_2": 0.8, "wrist_place": 0.1, "wrist_turn": 0.6, "wrist_linear": 0.1, "wrist_angular": 0.05,
             "joint_speeds": 0.1, "calm": 0.05, "wrist_calm": 0.05},
}  # fmt: skip


def rewards(name: str, tracking: Tracking) -> dict[str, np.ndarray]:
    """Every term (n,) times its weight; their sum is the reward. ValueError for a set that is not known."""
    if name not in REWARDS:
        raise ValueError(f"reward: expected one of {', '.join(sorted(REWARDS))}, got {name!r}")
    return {term: weight * TERMS[term].of(tracking) for term, weight in REWARDS[name].items()}


def tolerance_m(training_step: int) -> float:
    """How far off the mean of a level may be: 21 cm in the beginning of a training, 15 cm in the end."""
    return STRICT_M * LOOSE * (0.7 + 0.3 * float((2 * np.e) ** (-training_step / 3000)))


def failed(tracking: Tracking, tolerance: float, running_s: np.ndarray) -> np.ndarray:
    """(n,) bool: too far from the reference for its time, or faster than anything can be."""
    far = np.maximum(tracking.level_1_m.mean(axis=1), tracking.level_2_m.mean(axis=1)) > tolerance
    fast = (np.abs(tracking.linear_m_s).max(axis=1) > INSANE_M_S) | (np.abs(tracking.angular_rad_s).max(axis=1) > INSANE_RAD_S)
    return (far | fast | (np.abs(tracking.joints_rad_s).max(axis=1) > INSANE_RAD_S)) & (running_s > PATIENCE_S)
