"""Grasping worlds whose hand carries what it has gripped and raised, while spare fingers near N_t let go.

The rest of an episode is the policy's own. Starts and aims are those of `GraspWorlds`; `PlacedWorlds` has others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from afford.grasping.env.carry import carried
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.let_go import released
from afford.grasping.env.step_result import StepResult


class CarriedWorlds(GraspWorlds):
    """n worlds whose raised objects are carried to their goals, unless `carry` is false."""

    carry = True

    def step(self, action: np.ndarray, rngs: Sequence[np.random.Generator]) -> StepResult:
        """Apply actions (n, m), changed by `carried` and `released` where an object is gripped and raised."""
        return super().step(released(self, carried(self, action)) if self.carry else action, rngs)
