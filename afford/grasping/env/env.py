"""`afford/AffordanceGrasp-v0`: a hand grasps an object by the part that it should, lifts it, and keeps off the parts it should not.

    import gymnasium
    env = gymnasium.make("afford/AffordanceGrasp-v0")                 # the Shadow Hand and a hammer (default.py)
    env = gymnasium.make("afford/AffordanceGrasp-v0", hand=hand, task=task(body, negative=("blade",)), base="script")
    env = gymnasium.make("afford/AffordanceGrasp-v0", render_mode="rgb_array")        # env.render() -> (h, w, 3) uint8

Action (24,) in -1..1, 20 a second, rates of the motors' targets (act.py):

    0-2    x along the part to hold, y, z of the wrist      12-14  RFJ3 RFJ2 RFJ1
    3-5    yaw, pitch, roll of the wrist                    15-18  LFJ4 LFJ3 LFJ2 LFJ1
    6-8    FFJ3 FFJ2 FFJ1                                   19-23  THJ4 THJ3 THJ2 THJ1 THJ0
    9-11   MFJ3 MFJ2 MFJ1

With `action_mode="paper"` the wrist's numbers are a force and a torque, the others targets, 60 a second (wrench.py).

Observation, a vector by `layout` and `role` (observe.py). `layout="paper"` are the published numbers:

    0-21     q          44-65    torque      131-160  tip_force   167-190  action     207-235  unused
    22-43    qd         66-130   tips        161-166  palm        191-206  object     236-299  feature

Reward: the sum of `reward/...` in info (reward.py). Terminated when the object is out of reach, truncated after `steps`; the last
info has `report` (metrics.py). All in tables: docs/grasping/grasp-environments.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np

from afford.grasping.env import default
from afford.grasping.env.config import Config
from afford.grasping.env.core import Grasping
from afford.grasping.env.frame import Frames
from afford.grasping.env.single import Single
from afford.grasping.env.task import Task
from afford.grasping.env.vector import Many
from schemas.hand import HandModel

ID = "afford/AffordanceGrasp-v0"


class AffordanceGrasp(Single):
    """One world. Keywords are the fields of config.Config."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012  # the attribute is gymnasium's

    def __init__(self, hand: HandModel | None = None, task: Task | None = None, render_mode: str | None = None,
                 **config: Any) -> None:  # fmt: skip
        """The Shadow Hand and a hammer where none are given. ValueError or TypeError for what Config does not know."""
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode: expected rgb_array or None, got {render_mode!r}")
        self.render_mode = render_mode
        self.core = Grasping(hand or default.hand(), (task or default.tool(),), Config(**config))
        self.metadata = {**self.metadata, "render_fps": round(1 / self.core.config.control_s)}
        self._frames: Frames | None = None
        super().__init__(self.core)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; the same seed gives the same."""
        found = super().reset(seed=seed, options=options)
        if self.render_mode:
            self._frames = self._frames or Frames(self.core)
            self._frames.begin()
        return found

    def render(self) -> np.ndarray | None:  # type: ignore[override]  # gymnasium's is generic in the mode
        """(h, w, 3) uint8 of now; None without a render_mode. RuntimeError before the first reset."""
        if not self.render_mode:
            return None
        if self._frames is None:
            raise RuntimeError("AffordanceGrasp: expected a reset before the first frame; call reset()")
        return self._frames.draw()

    def __repr__(self) -> str:
        task, config = self.core.tasks[0], self.core.config
        return (f"AffordanceGrasp({task.body.name} by its {task.body.parts[task.hold]}, hand={self.core.scenes[0].hand.name!r}, "
                f"engine={config.engine!r}, layout={config.layout!r}, render_mode={self.render_mode!r})")


class AffordanceGraspVector(Many):
    """n worlds; tasks are taken in turn. Keywords are the fields of config.Config."""

    def __init__(self, num_envs: int, hand: HandModel, tasks: Sequence[Task], **config: Any) -> None:
        """ValueError without tasks."""
        if not tasks or num_envs < 1:
            raise ValueError("AffordanceGraspVector: expected a task or more and an environment or more, got "
                             f"{len(tasks)} and {num_envs}")
        self.core = Grasping(hand, [tasks[k % len(tasks)] for k in range(num_envs)], Config(**config))
        super().__init__(self.core, num_envs)


if ID not in gymnasium.registry:  # it is there where afford is installed: afford/environments.py
    gymnasium.register(id=ID, entry_point="afford.grasping.env.env:AffordanceGrasp",
                       vector_entry_point="afford.grasping.env.env:AffordanceGraspVector")  # fmt: skip
