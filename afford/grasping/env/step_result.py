"""Result of one step of n worlds, and the interface of everything that steps n worlds at once.

Worlds on a device take and return tensors (arrays.py); reports are arrays of numpy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np


@dataclass(frozen=True, eq=False)
class StepResult:
    """Result of one step of n worlds. Fields with a default are filled in by the layer that knows them."""

    reward: np.ndarray
    """(n,)"""
    terminated: np.ndarray
    """(n,) bool, the episode has failed or cannot go on: its value after this step is 0"""
    truncated: np.ndarray
    """(n,) bool, the episode was cut off by a limit of time"""
    terms: dict[str, np.ndarray] = field(default_factory=dict)
    """weighted reward terms (n,), whose sum is the reward"""
    success: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    """(n,) bool, the episode has reached success so far"""
    obs: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), np.float32))
    """(n, d) next observation: the first of the next episode where one has ended (gym_env.VectorEnv)"""
    final_obs: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), np.float32))
    """(n, d) observation that this step led to, before any reset (gym_env.VectorEnv)"""
    report: dict[str, np.ndarray] = field(default_factory=dict)
    """(n,) figures of the episodes that have ended; empty where none has (gym_env.VectorEnv)"""
    metrics: dict[str, float] = field(default_factory=dict)
    """scalars to log: numbers, or tensors () of worlds on a device (gym_env.PPOEnvAdapter)"""

    @property
    def done(self) -> np.ndarray:
        """(n,) bool, the episode has ended."""
        found: np.ndarray = self.terminated | self.truncated
        return found


class BatchedWorlds(Protocol):
    """n worlds that are stepped at once, without any reset of their own: GraspWorlds, HandImitationWorlds, GraspImitationWorlds."""

    @property
    def motors(self) -> int:
        """Width of an action."""

    @property
    def width(self) -> int:
        """Width of an observation."""

    def reset(self, which: Sequence[int], rngs: Sequence[np.random.Generator]) -> None:
        """Begin episodes in worlds `which`, with the generators of all worlds."""

    def step(self, action: np.ndarray, rngs: Sequence[np.random.Generator]) -> StepResult:
        """Apply the actions (n, m)."""

    def observe(self) -> np.ndarray:
        """(n, width) float32."""

    def report(self) -> dict[str, np.ndarray]:
        """(n,) figures of episodes that end now."""

    def save(self) -> Any:
        """Snapshot of the state that the next step depends on, without the generators."""

    def restore(self, token: Any) -> None:
        """Return to a snapshot."""

    def close(self) -> None:
        """Release the engine; a second call does nothing."""
