"""`afford/AffordanceGrasp-v0`: grasp an object by its positive part, lift it, and keep off its negative parts.

    import gymnasium
    env = gymnasium.make("afford/AffordanceGrasp-v0")                 # the Shadow Hand and a hammer (default.py)
    env = gymnasium.make("afford/AffordanceGrasp-v0", hand=hand, task=make_task(body, negative=("blade",)), base="script")
    env = gymnasium.make("afford/AffordanceGrasp-v0", render_mode="rgb_array")        # env.render() -> (h, w, 3) uint8

Action (24,) in -1..1, 20 per second, rates of the motors' targets (actions.py):

    0-2    x along the part to hold, y, z of the wrist      12-14  RFJ3 RFJ2 RFJ1
    3-5    yaw, pitch, roll of the wrist                    15-18  LFJ4 LFJ3 LFJ2 LFJ1
    6-8    FFJ3 FFJ2 FFJ1                                   19-23  THJ4 THJ3 THJ2 THJ1 THJ0
    9-11   MFJ3 MFJ2 MFJ1

With `action_mode="paper"` the wrist's numbers are a force and a torque, the others targets, 60 per second (actions.py).

Observation: a vector by `layout` and `role` (obs_blocks.py). `layout="paper"` has the published numbers:

    0-21     q          44-65    torque      131-160  tip_force   167-190  action     207-235  unused
    22-43    qd         66-130   tips        161-166  palm        191-206  object     236-299  feature

Reward: the sum of `reward/...` in info (reward.py). An episode is terminated when the object is out of reach and truncated after
`steps`; the last info has `report` (measures.py). Tables of all of it: docs/grasping/grasp-environments.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np

from afford.grasping.env import default
from afford.grasping.env.arrays import NUMPY, Arrays
from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.flight_recorder import FlightRecorder
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.gym_env import Env, VectorEnv
from afford.grasping.env.rendering import GraspRenderer
from afford.grasping.env.task import Task
from schemas.episodes import GraspTrace
from schemas.grasp import GraspTask
from schemas.hand import HandModel

ID = "afford/AffordanceGrasp-v0"
WIDTH, HEIGHT = 480, 360


class AffordanceGrasp(Env):
    """Grasping environment of one world. Keyword arguments are the fields of GraspEnvConfig."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012  # the attribute is gymnasium's

    def __init__(self, hand: HandModel | None = None, task: Task | None = None, render_mode: str | None = None,
                 **config: Any) -> None:  # fmt: skip
        """Create the environment, of the Shadow Hand and a hammer by default. ValueError or TypeError for a wrong keyword."""
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode: expected rgb_array or None, got {render_mode!r}")
        self.render_mode = render_mode
        self.core = GraspWorlds(hand or default.hand(), (task or default.tool(),), GraspEnvConfig(**config))
        self.metadata = {**self.metadata, "render_fps": round(1 / self.core.config.control_s)}
        self._frames: FrameRenderer | None = None
        super().__init__(self.core)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode; the same seed gives the same episode."""
        found = super().reset(seed=seed, options=options)
        if self.render_mode:
            self._frames = self._frames or FrameRenderer(self.core)
            self._frames.begin()
        return found

    def render(self) -> np.ndarray | None:  # type: ignore[override]  # gymnasium's is generic in the mode
        """(h, w, 3) uint8 frame of the current state; None without a render_mode. RuntimeError before the first reset."""
        if not self.render_mode:
            return None
        if self._frames is None:
            raise RuntimeError("AffordanceGrasp: no episode is running; call reset() before render()")
        return self._frames.draw()

    def __repr__(self) -> str:
        task, config = self.core.tasks[0], self.core.config
        return (f"AffordanceGrasp({task.body.name} by its {task.body.parts[task.hold]}, hand={self.core.scenes[0].hand.name!r}, "
                f"engine={config.engine!r}, layout={config.layout!r}, render_mode={self.render_mode!r})")


class AffordanceGraspVector(VectorEnv):
    """Grasping environment of n worlds; tasks are taken in turn. Keyword arguments are the fields of GraspEnvConfig."""

    def __init__(self, num_envs: int, hand: HandModel, tasks: Sequence[Task], recorder: FlightRecorder | None = None,
                 arrays: Arrays = NUMPY, **config: Any) -> None:  # fmt: skip
        """Create the environments; with tensors as `arrays`, `advance` takes and returns tensors. ValueError without a task."""
        if not tasks or num_envs < 1:
            raise ValueError("AffordanceGraspVector: expected one or more tasks and one or more environments, got "
                             f"{len(tasks)} and {num_envs}")
        self.core = GraspWorlds(hand, [tasks[k % len(tasks)] for k in range(num_envs)], GraspEnvConfig(**config), recorder,
                               arrays)  # fmt: skip
        super().__init__(self.core, num_envs)


class FrameRenderer:
    """Frames of world 0 for `render_mode="rgb_array"`, from a camera that is placed at the start of the episode."""

    def __init__(self, core: GraspWorlds) -> None:
        self._core = core
        self._renderer = GraspRenderer(core.scenes[0].hand, grasp_task(core.tasks[0]), WIDTH, HEIGHT)
        self._palm = np.zeros(7)

    def begin(self) -> None:
        """Place the camera at the start of an episode, by the pose of the palm."""
        self._palm = self._core.state().palm[0]

    def draw(self) -> np.ndarray:
        """(h, w, 3) uint8 frame of the current state."""
        state, none = self._core.state(), np.zeros((1, 0))
        now = GraspTrace(
            name="now", task=self._renderer.task.name, rate_hz=1 / self._core.config.control_s, q=state.q[:1],
            palm=self._palm[None], body=state.body[:1], tips=np.zeros((1, 0, 3)), force=none, force_negative=none,
            penetration_m=np.zeros(1), action=none, terms=(), reward=none, goal=self._core.goal()[0])  # fmt: skip
        return self._renderer.render(now, 0).rgb


def grasp_task(task: Task) -> GraspTask:
    """Convert a task to the pipeline's GraspTask, without a level and the name of a use."""
    names = task.body.parts
    negative, told = (tuple(name for name, bad in zip(names, parts, strict=True) if bad) for parts in (task.negative, task.told))
    return GraspTask(task.body.name, "", "", task.body, negative, names[task.hold], task.N_t, told, task.A_t)


if ID not in gymnasium.registry:  # an installed afford has registered it already: afford/environments.py
    gymnasium.register(id=ID, entry_point="afford.grasping.env.env:AffordanceGrasp",
                       vector_entry_point="afford.grasping.env.env:AffordanceGraspVector")  # fmt: skip
