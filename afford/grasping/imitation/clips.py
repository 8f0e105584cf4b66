"""References to be followed, read at the frame that is nearest to a control step; and what HandImitation can be told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from afford.grasping.hand.kinematics import moving_joints
from afford.grasping.imitation.imitation import REWARDS, STRICT_M
from afford.grasping.sim.engine import CONTROL_S
from afford.grasping.sim.scene import Physics
from schemas.hand import HandModel, HandReference

BASES = ("none", "reference")


@dataclass(frozen=True)
class ImitationConfig:
    """Keywords of HandImitation. ValueError for what they cannot mean."""

    engine: str = "mujoco"
    """mujoco or bullet"""
    physics: Physics = field(default_factory=Physics)
    """how carefully worlds are computed"""
    base: str = "none"
    """what actions are added to: none, or reference (its joints, a step ahead)"""
    reward: str = "paper"
    """paper or code (imitation.py)"""
    random_start: bool = True
    """whether episodes begin anywhere in the clip, or always at its beginning"""
    tolerance_m: float = STRICT_M
    """mean error of a level from which an episode fails; imitation.tolerance_m says how the paper's changes in a training"""
    threads: int = 1
    """that compute worlds"""

    def __post_init__(self) -> None:
        for name, allowed in (("base", BASES), ("reward", tuple(REWARDS))):
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name}: expected {' or '.join(allowed)}, got {getattr(self, name)!r}")
        if not self.tolerance_m > 0:
            raise ValueError(f"tolerance_m: expected a number above 0, got {self.tolerance_m}")


class Clips:
    """The references, by number."""

    def __init__(self, hand: HandModel, references: Sequence[HandReference]) -> None:
        """ValueError for no references, such of another hand, or such that are too short to be followed."""
        if not references:
            raise ValueError("references: expected one or more, got none")
        for one in references:
            _check(hand, one)
        self.references = tuple(references)
        self.steps = np.array([int((len(r.q) - 1) / r.rate_hz / CONTROL_S + 1e-9) + 1 for r in references])

    def at(self, name: str, clip: np.ndarray, step: np.ndarray) -> np.ndarray:
        """(n, ...) a field of references `clip` (n,) at control steps (n,); the last frame after the end."""
        return np.stack([self._row(name, k, s) for k, s in zip(clip.tolist(), step.tolist(), strict=True)])

    def _row(self, name: str, clip: int, step: int) -> np.ndarray:
        one = self.references[clip]
        rows: np.ndarray = getattr(one, name)
        return rows[min(round(step * CONTROL_S * one.rate_hz), len(rows) - 1)]


def _check(hand: HandModel, one: HandReference) -> None:
    d = len(moving_joints(hand.joints))
    if one.hand != hand.name or one.q.shape[1] != d:
        raise ValueError(f"reference {one.name}: expected {d} joints of the hand {hand.name}, got {one.q.shape[1]} of {one.hand}")
    if len(one.q) <= 2 * CONTROL_S * one.rate_hz:
        raise ValueError(f"reference {one.name}: expected more than {2 * CONTROL_S:g} s, got {len(one.q)} frames")
