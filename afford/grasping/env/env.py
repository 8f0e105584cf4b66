"""`afford/AffordanceGrasp-v0`: a hand grasps an object by the part that it should, lifts it, and keeps off the parts it should not.

    import gymnasium, afford.grasping.env.env
    env = gymnasium.make("afford/AffordanceGrasp-v0", hand=hand, task=task(body, negative=("blade",)), base="script")

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

from afford.grasping.env.config import Config
from afford.grasping.env.core import Grasping
from afford.grasping.env.single import Single
from afford.grasping.env.task import Task
from afford.grasping.env.vector import Many
from schemas.hand import HandModel

ID = "afford/AffordanceGrasp-v0"


class AffordanceGrasp(Single):
    """One world. Keywords are the fields of config.Config."""

    def __init__(self, hand: HandModel, task: Task, **config: Any) -> None:
        """ValueError or TypeError for what Config does not know."""
        self.core = Grasping(hand, (task,), Config(**config))
        super().__init__(self.core)


class AffordanceGraspVector(Many):
    """n worlds; tasks are taken in turn. Keywords are the fields of config.Config."""

    def __init__(self, num_envs: int, hand: HandModel, tasks: Sequence[Task], **config: Any) -> None:
        """ValueError without tasks."""
        if not tasks or num_envs < 1:
            raise ValueError("AffordanceGraspVector: expected a task or more and an environment or more, got "
                             f"{len(tasks)} and {num_envs}")
        self.core = Grasping(hand, [tasks[k % len(tasks)] for k in range(num_envs)], Config(**config))
        super().__init__(self.core, num_envs)


gymnasium.register(id=ID, entry_point="afford.grasping.env.env:AffordanceGrasp",
                   vector_entry_point="afford.grasping.env.env:AffordanceGraspVector")  # fmt: skip
