"""Rewards as named terms and tables of weights. A term is a function of what is measured; a set says what each is worth."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from afford.grasp.measures import TOUCH_N, Measures

GOAL_M = 0.05
"""the object is at its goal within it"""
NEGATIVE_M = 0.03
"""a fingertip is too near to a negative point within it"""
TIPS_GATE_M, PALM_GATE_M = 0.6, 0.12
LIFTED_M, RAISED_M = 0.03, 0.20
NEAR_M = 0.015
TIPS_CAP_M, PALM_CAP_M = 3.0, 0.5
GRASP_REACH_M, FORCES_CAP = 0.15, 2.0

TERMS: dict[str, Callable[[Measures], np.ndarray]] = {
    "hand": lambda m: m.palm_m,
    "goal": lambda m: m.goal_m,
    "success": lambda m: (m.goal_m < GOAL_M).astype(float),
    "negative_tips": lambda m: (m.N_m < NEGATIVE_M).sum(axis=1).astype(float),
    "fingers": lambda m: m.tips_centre_m.sum(axis=1).clip(max=TIPS_CAP_M),
    "palm": lambda m: m.palm_m.clip(max=PALM_CAP_M),
    "carry": lambda m: near(m) * (0.9 - 2 * m.goal_m),
    "hand_up": lambda m: near(m) * up(m),
    "arrived": lambda m: near(m) * (m.goal_m <= GOAL_M) / (1 + 10 * m.goal_m),
    "tips": lambda m: m.tips_m.mean(axis=1),
    "gripped_goal": lambda m: m.gripped * (GRASP_REACH_M - m.goal_m).clip(min=0),
    "gripped_success": lambda m: m.gripped * (m.goal_m < GOAL_M).astype(float),
    "negative_contacts": lambda m: (0.25 * (m.force_negative > TOUCH_N).sum(axis=1)).clip(max=FORCES_CAP),
    "negative_near": lambda m: m.touching.any(axis=1) * np.exp(-m.N_m.min(axis=1) / NEAR_M),
}
"""name -> (n,) before its weight; metres or counts (docs/grasp-environments.md)"""

REWARDS: Mapping[str, Mapping[str, float]] = {
    "afforddex": {"hand": -1.0, "goal": -1.0, "success": 1.0, "negative_tips": -10.0},
    "unidexgrasp++": {"fingers": -0.5, "palm": -1.0, "carry": 1.0, "hand_up": 1.0, "arrived": 1.0},
    "dense": {"tips": -2.0, "gripped_goal": 2.0, "gripped_success": 1.0, "negative_contacts": -1.0, "negative_near": -0.5},
}
"""set -> weights of its terms. `afforddex`: the paper's four; `unidexgrasp++`: what its code and that of AffordDex have (papers:
section 7.3); `dense`: learns from a base in minutes, and pays only what is gripped"""


def weights(name: str, changes: Mapping[str, float] | None = None) -> dict[str, float]:
    """The table of a set, with other weights for some terms (of any set). ValueError for a set or a term that is not known."""
    if name not in REWARDS:
        raise ValueError(f"reward: expected one of {', '.join(sorted(REWARDS))}, got {name!r}")
    if unknown := sorted(set(changes or {}) - set(TERMS)):
        raise ValueError(f"reward weights: expected terms among {', '.join(TERMS)}, got {', '.join(unknown)}")
    return {**REWARDS[name], **(changes or {})}


def rewards(table: Mapping[str, float], measured: Measures) -> dict[str, np.ndarray]:
    """Every term (n,) times its weight; their sum is the reward."""
    return {name: weight * TERMS[name](measured) for name, weight in table.items()}


def near(m: Measures) -> np.ndarray:
    """(n,) bool: the hand is at the object, as UniDexGrasp++ means it."""
    found: np.ndarray = (m.tips_centre_m.sum(axis=1) <= TIPS_GATE_M) & (m.palm_m <= PALM_GATE_M)
    return found


def up(m: Measures) -> np.ndarray:
    """(n,) for going up with an object that is off the table, more for one that is high."""
    return np.where(m.height_m >= RAISED_M, 0.2, np.where(m.height_m >= LIFTED_M, 0.1 + 0.1 * m.action[:, 2], 0.0))
