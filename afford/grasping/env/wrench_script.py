"""The grasp by script where actions are wrenches: springs pull the wrist along the script, so that the reward is attainable."""

from __future__ import annotations

import numpy as np

from afford.grasping.env import wrench
from afford.grasping.env.base import script_steps, scripted
from afford.grasping.env.core import Grasping
from afford.grasping.hand.kinematics import command_limits, commanded_columns
from afford.grasping.sim.engine import CONTROL_S

PULL_N_M, HOLD_N_S_M = 1600.0, 80.0
"""spring of the slides, and what drag takes (scene.py) is given back"""
PULL_NM_RAD, HOLD_NM_S_RAD = 6.0, 0.3
"""of the hinges"""


class Script:
    """Acts as the script does, for the objects as they lie at the first step of an episode."""

    def __init__(self) -> None:
        self._path: np.ndarray | None = None

    def act(self, now: Grasping) -> np.ndarray:
        """(n, m)."""
        q = now.state().q[:, commanded_columns(now.scenes[0].hand.joints)]
        if self._path is None or not now.steps_done().any():
            lift_m = now.config.lift_m
            path = [scripted(scene, aim, script_steps(lift_m), lift_m) for scene, aim in zip(now.scenes, now.aims, strict=True)]
            self._path = np.concatenate([q[:, None], np.stack(path)], axis=1)
        wanted, speed = _at(self._path, (now.steps_done() + 1) * now.config.control_s)
        error = wanted[:, :6] - q[:, :6]
        pull, drag = np.repeat([PULL_N_M, PULL_NM_RAD], 3), np.repeat([HOLD_N_S_M, HOLD_NM_S_RAD], 3)
        efforts = pull * error + drag * speed[:, :6]
        return wrench.action_for(efforts, wanted[:, 6:], q[:, :6], now.episode.yaw, command_limits(now.scenes[0].hand.joints))


def _at(path: np.ndarray, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, m) where paths (n, t, m) of the script's own steps are at times (n,), and how fast they go."""
    at = np.minimum(time_s / CONTROL_S, path.shape[1] - 1)
    low, rows = np.minimum(at.astype(int), path.shape[1] - 2), np.arange(len(path))
    before, after = path[rows, low], path[rows, low + 1]
    moving = (at < path.shape[1] - 1)[:, None]
    return before + (at - low)[:, None] * (after - before), moving * (after - before) / CONTROL_S
