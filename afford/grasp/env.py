"""`afford/AffordanceGrasp-v0`: a hand grasps an object by the part that it should, lifts it, and keeps off the parts it should not.

    import gymnasium, afford.grasp.env
    env = gymnasium.make("afford/AffordanceGrasp-v0", hand=hand, task=task(body, negative=("blade",)), base="script")

Action (24,) in -1..1, 20 a second: rates of the wrist (x along the part to hold, y, z, yaw, pitch, roll) and of 18 motors of
fingers (THJ4 to THJ0 last); see act.py. Observation: a vector, see observe.py. Reward: the sum of `reward/...` in info, see
reward.py. Terminated when the object is out of reach, truncated after `steps`; the last info has `report`, see metrics.py. All in
tables: docs/grasp-environments.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium

from afford.grasp.config import Config
from afford.grasp.core import Grasping
from afford.grasp.single import Single
from afford.grasp.task import Task
from afford.grasp.vector import Many
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


gymnasium.register(id=ID, entry_point="afford.grasp.env:AffordanceGrasp",
                   vector_entry_point="afford.grasp.env:AffordanceGraspVector")  # fmt: skip
