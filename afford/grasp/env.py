"""`afford/AffordanceGrasp-v0`: a hand grasps an object by the part that it should, lifts it, and keeps off the parts it should not.

    import gymnasium, afford.grasp.env
    env = gymnasium.make("afford/AffordanceGrasp-v0", hand=hand, task=task(body, negative=("blade",)), base="script")

Action (24,) in -1..1, 20 a second: rates of the wrist (x along the part to hold, y, z, yaw, pitch, roll) and of 18 motors of
fingers (THJ4 to THJ0 last); see act.py. Observation: a vector, see observe.py. Reward: the sum of `reward/...` in info, see
reward.py. Terminated when the object is out of reach, truncated after `steps`; the last info has `report`, see metrics.py. All in
tables: docs/grasp-environments.md.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from afford.grasp.config import Config
from afford.grasp.core import Grasping
from afford.grasp.observe import LIMIT
from afford.grasp.task import Task
from schemas.hand import HandModel

ID = "afford/AffordanceGrasp-v0"


class AffordanceGrasp(gymnasium.Env):
    """One world. Keywords are the fields of config.Config."""

    metadata = {"render_modes": []}  # noqa: RUF012  # the attribute is gymnasium's

    def __init__(self, hand: HandModel, task: Task, **config: Any) -> None:
        """ValueError or TypeError for what Config does not know."""
        self.grasping = Grasping(hand, (task,), Config(**config))
        self.observation_space = spaces.Box(-LIMIT, LIMIT, (self.grasping.width,), np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (self.grasping.motors,), np.float32)
        self._over = True

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; the same seed gives the same."""
        super().reset(seed=seed)
        self.grasping.reset([0], [self.np_random])
        self._over = False
        return self.grasping.observe()[0], {"success": False}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """A twentieth of a second. RuntimeError when the episode is over."""
        if self._over:
            raise RuntimeError("AffordanceGrasp: expected a reset, since no episode is under way")
        out = self.grasping.step(np.asarray(action)[None], [self.np_random])
        info: dict[str, Any] = {"success": bool(out.success[0])}
        info |= {f"reward/{name}": float(term[0]) for name, term in out.terms.items()}
        self._over = bool(out.terminated[0] or out.truncated[0])
        if self._over:
            info["report"] = {name: float(figure[0]) for name, figure in self.grasping.report().items()}
        return self.grasping.observe()[0], float(out.reward[0]), bool(out.terminated[0]), bool(out.truncated[0]), info

    def save(self) -> Any:
        """Everything that the next steps depend on."""
        return self.grasping.save(), self.np_random.bit_generator.state, self._over

    def restore(self, token: Any) -> np.ndarray:
        """Back to what was saved; it goes on as it did then. The observation."""
        self.grasping.restore(token[0])
        self.np_random.bit_generator.state = token[1]
        self._over = token[2]
        return self.grasping.observe()[0]

    def close(self) -> None:
        """Give the engine back; twice is harmless."""
        self.grasping.close()


gymnasium.register(id=ID, entry_point="afford.grasp.env:AffordanceGrasp",
                   vector_entry_point="afford.grasp.vector:AffordanceGraspVector")  # fmt: skip
