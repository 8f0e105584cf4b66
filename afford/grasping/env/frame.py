"""Frames of an episode as it goes on, for `render_mode="rgb_array"`: drawn by the studio from the state, without a window."""

from __future__ import annotations

import numpy as np

from afford.grasping.env.core import Grasping
from afford.grasping.env.studio import Studio
from afford.grasping.env.task import Task
from schemas.episodes import GraspTrace
from schemas.grasp import GraspTask

WIDTH, HEIGHT = 480, 360


class Frames:
    """Frames of world 0. The camera stands where the hand of the episode began, and stays there."""

    def __init__(self, core: Grasping) -> None:
        self._core = core
        self._studio = Studio(core.scenes[0].hand, described(core.tasks[0]), WIDTH, HEIGHT)
        self._palm = np.zeros(7)

    def begin(self) -> None:
        """Note where the hand is, at the beginning of an episode."""
        self._palm = self._core.state().palm[0]

    def draw(self) -> np.ndarray:
        """(h, w, 3) uint8 of now."""
        return self._studio.shoot(self._now(), 0).rgb

    def _now(self) -> GraspTrace:
        """A trace of one row; what is not drawn is empty."""
        state, none = self._core.state(), np.zeros((1, 0))
        return GraspTrace(
            name="now", task=self._studio.task.name, rate_hz=1 / self._core.config.control_s, q=state.q[:1], palm=self._palm[None],
            body=state.body[:1], tips=np.zeros((1, 0, 3)), force=none, force_negative=none, penetration_m=np.zeros(1), action=none,
            terms=(), reward=none, goal=self._core.goal()[0])  # fmt: skip


def described(task: Task) -> GraspTask:
    """A task as the pipeline passes it on, without a name of its use."""
    names = task.body.parts
    negative, told = (tuple(name for name, bad in zip(names, parts, strict=True) if bad) for parts in (task.negative, task.told))
    return GraspTask(task.body.name, "", "", task.body, negative, names[task.hold], task.N_t, told, task.A_t)
