"""Who can teach: an Actor (evaluate.py) that sees everything. Trained teachers are in acting.py; this one needs no training."""

from __future__ import annotations

import numpy as np

from afford.grasping.env import base
from afford.grasping.env.core import Grasping
from afford.grasping.sim.scripted import Aim, aim_at_part


class Guide:
    """The grasp by script at the part that is to be held, wherever the hand has begun: what to correct, step by step."""

    def __init__(self) -> None:
        self._wanted: dict[int, np.ndarray] = {}

    def act(self, now: Grasping) -> np.ndarray:
        """(n, m) what leads the targets to those of the plan, as far as one step goes. Plans are made when episodes begin."""
        step, pose, yaw, config = now.steps_done(), now.state().body, now.now().episode.yaw, now.config
        for k in np.flatnonzero(step == 0).tolist():
            aim = _turned(aim_at_part(now.scenes[k], pose[k], now.tasks[k].hold), yaw[k])
            self._wanted[k] = base.scripted(now.scenes[k], aim, config.steps, config.lift_m, config.wait)
        at = step.clip(max=config.steps - 1)
        return now.correction(np.stack([self._wanted[k][at[k]] for k in range(len(step))]))


def _turned(aim: Aim, yaw: float) -> Aim:
    """The aim, half a turn about where that is nearer to the yaw at which the hand began."""
    return aim if np.cos(aim.yaw - yaw) >= 0 else Aim(aim.place, float(aim.yaw % (2 * np.pi) - np.pi))
