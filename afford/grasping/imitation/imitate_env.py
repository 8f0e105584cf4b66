"""`afford/HandImitation-v0`: a robot hand follows reference motion, retargeted from people (AffordDex, stage 1: HTI).

    import gymnasium
    env = gymnasium.make("afford/HandImitation-v0", hand=hand, body=body, references=references, reward="paper")

Control runs at 20 steps per second; the reference is read at the frame nearest in time. An episode begins at a random frame in
the first 98 % of its clip. It is terminated when the hand is too far off, and truncated at the end of the clip, which is the
success. The object lies out of the way: only the motion of the hand is learned.

Action (24,) in -1..1 as in afford/AffordanceGrasp-v0, along the axes of the world. Observation: HandImitationWorlds.observe.
Reward: the sum of `reward/...` in info (tracking.py). The last info has `report`. Tables: docs/grasping/grasp-environments.md.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env import actions
from afford.grasping.env.gym_env import Env, VectorEnv
from afford.grasping.env.obs_blocks import LIMIT
from afford.grasping.env.scenery import palm_yaw, to_frame
from afford.grasping.env.step_result import StepResult
from afford.grasping.hand.kinematics import command_limits, commanded_columns, forward_kinematics, moving_joints
from afford.grasping.imitation.tracking import (
    FIELDS,
    FINAL_TOLERANCE_M,
    REWARDS,
    ReferenceClips,
    Tracker,
    Tracking,
    imitation_rewards,
    tracking_failed,
)
from afford.grasping.sim.engine import CONTROL_S, State
from afford.grasping.sim.scene import Physics, Scene
from afford.grasping.sim.worlds import ThreadWorlds
from schemas.grasp import GraspObject
from schemas.hand import HandModel, HandReference

BASES = ("none", "reference")


@dataclass(frozen=True)
class ImitationConfig:
    """Keyword arguments of HandImitation. ValueError for an unknown or impossible value."""

    engine: str = "mujoco"
    """mujoco or bullet"""
    physics: Physics = field(default_factory=Physics)
    """rate and accuracy of the physics"""
    base: str = "none"
    """targets that actions are added to: none (the joints at the start), or reference (its joints, a step ahead)"""
    reward: str = "paper"
    """set of reward terms: paper or code (tracking.py)"""
    random_start: bool = True
    """begin episodes at a random frame of the clip; else at its first frame"""
    tolerance_m: float = FINAL_TOLERANCE_M
    """mean error of a level from which an episode fails: that at the end of the paper's schedule, which begins with 21 cm"""
    threads: int = 1
    """threads that compute worlds"""

    def __post_init__(self) -> None:
        for name, allowed in (("base", BASES), ("reward", tuple(REWARDS))):
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name}: expected {' or '.join(allowed)}, got {getattr(self, name)!r}")
        if not self.tolerance_m > 0:
            raise ValueError(f"tolerance_m: expected a number above 0, got {self.tolerance_m}")


OBJECT_POSE = np.array([1.9, 1.9, 0.01, 0.0, 0.0, 0.0, 1.0])
"""pose of the object, out of the way"""
BEGIN_SHARE = 0.98
"""share of a clip in which episodes begin"""


class HandImitationWorlds:
    """n worlds in which a hand follows references; at each reset a world draws one of them."""

    def __init__(self, hand: HandModel, body: GraspObject, references: Sequence[HandReference], count: int,
                 config: ImitationConfig) -> None:  # fmt: skip
        """Build `count` worlds. ValueError without references, or for those of another hand."""
        self.hand, self.clips, self.config = hand, ReferenceClips(hand, references), config
        self.worlds = ThreadWorlds(config.engine, [Scene(hand, body, config.physics)] * count, config.threads)
        self._of_motor, self._tracker = commanded_columns(hand.joints), Tracker(hand)
        self._limits = command_limits(hand.joints)
        self.rates = actions.rate_table(actions.RATES["none" if config.base == "none" else "script"], len(self._limits))
        self._now = _EpisodeState(count, len(self._limits))
        self._state: State | None = None

    @property
    def motors(self) -> int:
        """Width of an action."""
        return len(self._limits)

    @property
    def width(self) -> int:
        """Width of an observation."""
        return (len(moving_joints(self.hand.joints)) - 6) * 2 + 2 * self.motors + 12 + 6 * len(self.hand.fingers.name) + 1

    def reset(self, which: Sequence[int], rngs: Sequence[np.random.Generator]) -> None:
        """Begin episodes in worlds `which`, each at a frame of a clip."""
        now = self._now
        for k in which:
            clip = int(rngs[k].integers(len(self.clips.steps)))
            latest = max(1, int(BEGIN_SHARE * (self.clips.steps[clip] - 1)))
            first = int(rngs[k].integers(latest)) if self.config.random_start else 0
            q = self.clips.at("q", np.array([clip]), np.array([first]))[0]
            now.begin(k, clip, first, q[self._of_motor])
            self.worlds.reset(q[None], OBJECT_POSE[None], [k])
        self._state = self.worlds.state()

    def step(self, action: np.ndarray, rngs: Sequence[np.random.Generator]) -> StepResult:
        """Apply actions (n, m) for one control step. ValueError for actions that are not finite."""
        now = self._now
        action = actions.checked(action, now.offset.shape)
        now.step = now.step + 1
        base = self._reference("q")[:, self._of_motor] if self.config.base == "reference" else now.start
        offset = actions.moved(self.rates, now.offset, action)
        now.sent, now.offset = actions.rate_command(base, offset, np.zeros(len(action)), self._limits)
        self._state = self.worlds.step(now.sent, CONTROL_S)
        tracking = self.tracking()
        now.error_m += (tracking.level_1_m.mean(axis=1) + tracking.level_2_m.mean(axis=1)) / 2
        terms = imitation_rewards(self.config.reward, tracking)
        fails = tracking_failed(tracking, self.config.tolerance_m, (now.step - now.first) * CONTROL_S)
        ends = (now.step >= self.clips.steps[now.clip] - 1) & ~fails
        return StepResult(np.sum(list(terms.values()), axis=0), fails, ends, terms, ends.copy())

    def tracking(self) -> Tracking:
        """Current tracking errors."""
        return self._tracker.compare(self.state(), {name: self._reference(name) for name in FIELDS})

    def observe(self) -> np.ndarray:
        """(n, width) float32 observations of the current state.

        In order: finger joints and 0.2 x their speeds; last targets minus joints, and the reference's joints a step ahead minus
        joints, both in full actions; in the palm's yaw its velocity, its angular velocity x 0.2, its position and rotation errors a
        step ahead, and the errors of both levels of fingers; share of the clip that has passed.
        """
        now, state = self._now, self.state()
        T, joints = forward_kinematics(self.hand.joints, state.q), state.q[:, self._of_motor]
        palm, yaw = self._reference("T_world_palm", ahead=1), palm_yaw(self.hand, state)
        turn = (Rotation.from_matrix(palm[:, :3, :3]) * Rotation.from_quat(state.palm[:, 3:]).inv()).as_rotvec()
        velocity = self._tracker.palm_velocity(T, state)
        arrows = np.stack([velocity[:, :3], 0.2 * velocity[:, 3:], palm[:, :3, 3] - state.palm[:, :3], turn], axis=1)
        away = [self._reference(name, ahead=1) - places for name, places in self._tracker.levels(T).items()]
        reference = self._reference("q", ahead=1)[:, self._of_motor]
        phase = (now.step / self.clips.steps[now.clip])[:, None]
        vectors = to_frame(np.concatenate([arrows, *away], axis=1), yaw).reshape(len(yaw), -1)
        parts = (state.q[:, 6:], 0.2 * state.qd[:, 6:], (now.sent - joints) / self.rates[:, 0],
                 (reference - joints) / self.rates[:, 0], vectors, phase)  # fmt: skip
        return np.concatenate(parts, axis=1).clip(-LIMIT, LIMIT).astype(np.float32)

    def report(self) -> dict[str, np.ndarray]:
        """(n,) figures of episodes that end now: success (the end of the clip was reached), mean error of both levels, steps."""
        now, tracking = self._now, self.tracking()
        took = now.step - now.first
        fails = tracking_failed(tracking, self.config.tolerance_m, took * CONTROL_S)
        reached = (now.step >= self.clips.steps[now.clip] - 1) & ~fails
        return {"success": reached.astype(float), "error_m": now.error_m / np.maximum(took, 1), "steps": took.astype(float)}

    def state(self) -> State:
        """State of all worlds. RuntimeError before the first reset."""
        if self._state is None:
            raise RuntimeError("HandImitationWorlds: no episode is running; call reset() first")
        return self._state

    def save(self) -> Any:
        """Snapshot of the state that the next step depends on, without the caller's generators."""
        return self.worlds.save(), copy.deepcopy(self._now)

    def restore(self, token: Any) -> None:
        """Return to a snapshot."""
        self._state, self._now = self.worlds.restore(token[0]), copy.deepcopy(token[1])

    def close(self) -> None:
        """Release the engine; a second call does nothing."""
        self.worlds.close()

    def _reference(self, name: str, ahead: int = 0) -> np.ndarray:
        """(n, ...) field of the references at this step, or some steps ahead."""
        return self.clips.at(name, self._now.clip, self._now.step + ahead)


class _EpisodeState:
    """Progress of the running episodes, arrays of (n, ...). `copy.deepcopy` makes an independent copy."""

    def __init__(self, n: int, motors: int) -> None:
        self.clip, self.first, self.step = np.zeros(n, int), np.zeros(n, int), np.zeros(n, int)
        self.start, self.sent, self.offset = np.zeros((n, motors)), np.zeros((n, motors)), np.zeros((n, motors))
        self.error_m = np.zeros(n)

    def begin(self, k: int, clip: int, first: int, u: np.ndarray) -> None:
        """Start an episode of world k."""
        self.clip[k], self.first[k], self.step[k] = clip, first, first
        self.start[k], self.sent[k], self.offset[k], self.error_m[k] = u, u, 0.0, 0.0


ID = "afford/HandImitation-v0"


class HandImitation(Env):
    """Imitation environment of one world. Keyword arguments are the fields of ImitationConfig."""

    def __init__(self, hand: HandModel, body: GraspObject, references: Sequence[HandReference], **config: Any) -> None:
        """Create the environment; `body` lies out of the way. ValueError without references, or for those of another hand."""
        self.core = HandImitationWorlds(hand, body, references, 1, ImitationConfig(**config))
        super().__init__(self.core)


class HandImitationVector(VectorEnv):
    """Imitation environment of n worlds. Keyword arguments are the fields of ImitationConfig."""

    def __init__(self, num_envs: int, hand: HandModel, body: GraspObject, references: Sequence[HandReference],
                 **config: Any) -> None:  # fmt: skip
        """Create the environments, with the arguments of HandImitation."""
        self.core = HandImitationWorlds(hand, body, references, num_envs, ImitationConfig(**config))
        super().__init__(self.core, num_envs)


if ID not in gymnasium.registry:  # an installed afford has registered it already: afford/environments.py
    gymnasium.register(id=ID, entry_point="afford.grasping.imitation.imitate_env:HandImitation",
                       vector_entry_point="afford.grasping.imitation.imitate_env:HandImitationVector")  # fmt: skip
