"""Rewards: named terms, which are functions of the measurements (arrays or tensors), and sets of weights for them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from afford.common.arrays import namespace, number
from afford.grasping.env.measures import GOAL_M, TOUCH_N, Measures

NEGATIVE_M = 0.03
"""distance to a negative point within which a fingertip is penalized"""
TIPS_GATE_M, PALM_GATE_M = 0.6, 0.12
LIFTED_M, RAISED_M = 0.03, 0.20
NEAR_M = 0.04
TIPS_CAP_M, PALM_CAP_M = 3.0, 0.5
GRASP_REACH_M = 0.15


class Term(NamedTuple):
    """Reward term: its meaning and its function."""

    doc: str
    of: Callable[[Measures], np.ndarray]
    """measurements -> (n,), before the weight"""


TERMS: Mapping[str, Term] = {
    "hand": Term("m, middle of the palm to the object's centre of mass", lambda m: m.palm_m),
    "goal": Term("m, the object's centre of mass to its goal", lambda m: m.goal_m),
    "success": Term("1 where the object is within 5 cm of its goal", lambda m: number(m.goal_m < GOAL_M)),
    "negative_tips": Term("fingertips within 3 cm of a negative point",
                          lambda m: number((m.N_m < NEGATIVE_M).sum(axis=1))),
    "fingers": Term("m, sum of fingertips to the object's centre of mass, at most 3",
                    lambda m: m.tips_centre_m.sum(axis=1).clip(max=TIPS_CAP_M)),
    "palm": Term("m, middle of the palm to the object's centre of mass, at most 0.5", lambda m: m.palm_m.clip(max=PALM_CAP_M)),
    "carry": Term("0.9 - 2 x m to the goal, where the hand is near: fingers at most 0.6 and palm at most 0.12 m",
                  lambda m: near(m) * (0.9 - 2 * m.goal_m)),
    "hand_up": Term("where near: 0.1 + 0.1 x upward action for an object 3 cm above the table, 0.2 from 20 cm on",
                    lambda m: near(m) * up(m)),
    "arrived": Term("where near and within 5 cm of the goal: 1 / (1 + 10 x m to it)",
                    lambda m: near(m) * (m.goal_m <= GOAL_M) / (1 + 10 * m.goal_m)),
    "tips": Term("m, mean of fingertips to the object's surface", lambda m: m.tips_m.mean(axis=1)),
    "gripped_goal": Term("m by which the object is nearer to its goal than 15 cm, where two or more of fingers and palm press",
                         lambda m: m.gripped * (GRASP_REACH_M - m.goal_m).clip(min=0)),
    "gripped_success": Term("1 where gripped and within 5 cm of the goal", lambda m: m.gripped * number(m.goal_m < GOAL_M)),
    "positive": Term("m, mean of fingertips to the nearest positive point; 0 where no such points are known",
                     lambda m: m.positive_m.mean(axis=1)),
    "negative_contacts": Term("0.25 for each of fingers and palm that presses on a part that is negative by N_t",
                              lambda m: 0.25 * number((m.force_told > TOUCH_N).sum(axis=1))),
    "negative_detour": Term("m, mean over fingertips of the distance to the nearest allowed point minus that to the surface",
                            lambda m: (m.allowed_m - m.tips_m).mean(axis=1)),
    "negative_near": Term("mean over fingertips of 1 - distance to the nearest negative point / 4 cm, at least 0",
                          lambda m: (1 - m.N_m / NEAR_M).clip(min=0).mean(axis=1)),
}  # fmt: skip

REWARDS: Mapping[str, Mapping[str, float]] = {
    "afforddex": {"hand": -1.0, "goal": -1.0, "success": 1.0, "negative_tips": -10.0},
    "unidexgrasp++": {"fingers": -0.5, "palm": -1.0, "carry": 1.0, "hand_up": 1.0, "arrived": 1.0},
    "dense": {"tips": -2.0, "gripped_goal": 2.0, "gripped_success": 1.0, "positive": 0.0, "negative_contacts": -0.5,
              "negative_detour": -4.0, "negative_near": -0.7},
}
"""set -> weights of its terms. `afforddex`: the paper's four terms; `unidexgrasp++`: the terms of its code and of AffordDex's code;
`dense`: learns from a base in minutes, and rewards only gripped objects"""


def reward_weights(name: str, changes: Mapping[str, float] | None = None) -> dict[str, float]:
    """Weights of a set, with the weights of some terms (of any set) replaced. ValueError for an unknown set or term."""
    if name not in REWARDS:
        raise ValueError(f"reward: expected one of {', '.join(sorted(REWARDS))}, got {name!r}")
    if unknown := sorted(set(changes or {}) - set(TERMS)):
        raise ValueError(f"reward weights: expected terms among {', '.join(TERMS)}, got {', '.join(unknown)}")
    return {**REWARDS[name], **(changes or {})}


def scaled_negative_weights(name: str, scale: float) -> dict[str, float]:
    """Scale the negative terms of a set; 0 switches off exactly these. ValueError for an unknown set.

    A set without negative terms gets those of `dense`, so that negative affordance can be added to any reward.
    """
    return {term: scale * weight for term, weight in (_negative(name) or _negative("dense")).items()}


def _negative(name: str) -> dict[str, float]:
    return {term: weight for term, weight in reward_weights(name).items() if term.startswith("negative")}


def rewards(table: Mapping[str, float], measured: Measures) -> dict[str, np.ndarray]:
    """Compute every term (n,) times its weight; the sum of all is the reward."""
    return {name: weight * TERMS[name].of(measured) for name, weight in table.items()}


def near(m: Measures) -> np.ndarray:
    """(n,) bool, the hand is at the object, as UniDexGrasp++ defines it."""
    found: np.ndarray = (m.tips_centre_m.sum(axis=1) <= TIPS_GATE_M) & (m.palm_m <= PALM_GATE_M)
    return found


def up(m: Measures) -> np.ndarray:
    """(n,) reward for moving up with an object that is off the table; 0.2 from 20 cm on."""
    where = namespace(m.height_m).where
    found: np.ndarray = where(m.height_m >= RAISED_M, 0.2, where(m.height_m >= LIFTED_M, 0.1 + 0.1 * m.action[:, 2], 0.0))
    return found
