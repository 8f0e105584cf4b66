"""n hands that follow references, one clip each at a time. imitate_env.py has it in gymnasium's words.

20 actions a second; the reference is read at the frame that is nearest in time. An episode begins anywhere in the first 98 % of its
clip, fails (terminated) when the hand is too far off, and is cut off (truncated) at the end of the clip. The object lies aside: it
is the hand's motion that is learned.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env import act
from afford.grasping.env.happened import Happened
from afford.grasping.env.observe import LIMIT
from afford.grasping.env.scenery import palm_yaw, to_frame
from afford.grasping.hand.kinematics import command_limits, commanded_columns, forward_kinematics, moving_joints
from afford.grasping.imitation.clips import Clips, ImitationConfig
from afford.grasping.imitation.imitation import Tracking, failed, rewards
from afford.grasping.imitation.track import FIELDS, Tracker
from afford.grasping.sim.engine import CONTROL_S, State
from afford.grasping.sim.scene import Scene
from afford.grasping.sim.worlds import ThreadWorlds
from schemas.grasp import GraspObject
from schemas.hand import HandModel, HandReference

ASIDE = np.array([1.9, 1.9, 0.01, 0.0, 0.0, 0.0, 1.0])
BEGIN_SHARE = 0.98


class Imitating:
    """n worlds. At each reset a world takes one of the references."""

    def __init__(self, hand: HandModel, body: GraspObject, references: Sequence[HandReference], count: int,
                 config: ImitationConfig) -> None:  # fmt: skip
        """ValueError for no references, or such of another hand."""
        self.hand, self.clips, self.config = hand, Clips(hand, references), config
        self.worlds = ThreadWorlds(config.engine, [Scene(hand, body, config.physics)] * count, config.threads)
        self._of_motor, self._tracker = commanded_columns(hand.joints), Tracker(hand)
        self._limits = command_limits(hand.joints)
        self.rates = act.table(act.RATES["none" if config.base == "none" else "script"], len(self._limits))
        self._now = _Following(count, len(self._limits))
        self._state: State | None = None

    @property
    def motors(self) -> int:
        """Width of an action."""
        return len(self._limits)

    @property
    def width(self) -> int:
        """Of an observation: see `observe`."""
        return (len(moving_joints(self.hand.joints)) - 6) * 2 + 2 * self.motors + 12 + 6 * len(self.hand.fingers.name) + 1

    def reset(self, which: Sequence[int], rngs: Sequence[np.random.Generator]) -> None:
        """Begin in worlds `which`: a clip, and a frame of it."""
        now = self._now
        for k in which:
            clip = int(rngs[k].integers(len(self.clips.steps)))
            latest = max(1, int(BEGIN_SHARE * (self.clips.steps[clip] - 1)))
            first = int(rngs[k].integers(latest)) if self.config.random_start else 0
            q = self.clips.at("q", np.array([clip]), np.array([first]))[0]
            now.begin(k, clip, first, q[self._of_motor])
            self.worlds.reset(q[None], ASIDE[None], [k])
        self._state = self.worlds.state()

    def step(self, action: np.ndarray, rngs: Sequence[np.random.Generator]) -> Happened:
        """Act (n, m). ValueError for actions that are not finite."""
        now = self._now
        action = act.checked(action, now.offset.shape)
        now.step = now.step + 1
        base = self._wanted("q")[:, self._of_motor] if self.config.base == "reference" else now.start
        now.sent, now.offset = act.command(base, act.moved(self.rates, now.offset, action), np.zeros(len(action)), self._limits)
        self._state = self.worlds.step(now.sent, CONTROL_S)
        tracking = self.tracking()
        now.error_m += (tracking.level_1_m.mean(axis=1) + tracking.level_2_m.mean(axis=1)) / 2
        terms = rewards(self.config.reward, tracking)
        fails = failed(tracking, self.config.tolerance_m, (now.step - now.first) * CONTROL_S)
        ends = (now.step >= self.clips.steps[now.clip] - 1) & ~fails
        return Happened(np.sum(list(terms.values()), axis=0), terms, fails, ends, ends.copy())

    def tracking(self) -> Tracking:
        """How the hands are beside their references, now."""
        return self._tracker.compare(self.state(), {name: self._wanted(name) for name in FIELDS})

    def observe(self) -> np.ndarray:
        """(n, width) float32: fingers' joints and 0.2 x their speed; last targets less joints, in full actions; the reference's
        joints a step ahead less joints, in full actions; then in the palm's yaw its velocity, its spin x 0.2, and how far and by
        which turn it is off a step ahead; how far both levels of fingers are off; share of the clip that is over.
        """
        now, state = self._now, self.state()
        T, joints = forward_kinematics(self.hand.joints, state.q), state.q[:, self._of_motor]
        palm, yaw = self._wanted("T_world_palm", ahead=1), palm_yaw(self.hand, state)
        turn = (Rotation.from_matrix(palm[:, :3, :3]) * Rotation.from_quat(state.palm[:, 3:]).inv()).as_rotvec()
        velocity = self._tracker.palm_velocity(T, state)
        arrows = np.stack([velocity[:, :3], 0.2 * velocity[:, 3:], palm[:, :3, 3] - state.palm[:, :3], turn], axis=1)
        away = [self._wanted(name, ahead=1) - places for name, places in self._tracker.levels(T).items()]
        wanted = self._wanted("q", ahead=1)[:, self._of_motor]
        over = (now.step / self.clips.steps[now.clip])[:, None]
        parts = (state.q[:, 6:], 0.2 * state.qd[:, 6:], (now.sent - joints) / self.rates[:, 0],
                 (wanted - joints) / self.rates[:, 0], to_frame(np.concatenate([arrows, *away], axis=1), yaw).reshape(len(yaw), -1),
                 over)  # fmt: skip
        return np.concatenate(parts, axis=1).clip(-LIMIT, LIMIT).astype(np.float32)

    def report(self) -> dict[str, np.ndarray]:
        """Of episodes that end now: whether the end was reached, mean error (n,) of both levels, and how many steps it took."""
        now, tracking = self._now, self.tracking()
        took = now.step - now.first
        fails = failed(tracking, self.config.tolerance_m, took * CONTROL_S)
        reached = (now.step >= self.clips.steps[now.clip] - 1) & ~fails
        return {"success": reached.astype(float), "error_m": now.error_m / np.maximum(took, 1), "steps": took.astype(float)}

    def state(self) -> State:
        """Of all worlds. RuntimeError before the first reset."""
        if self._state is None:
            raise RuntimeError("expected a reset before the first step")
        return self._state

    def save(self) -> Any:
        """Everything that the next step depends on, but the generators of the caller."""
        return self.worlds.save(), copy.deepcopy(self._now)

    def restore(self, token: Any) -> None:
        """Back to what was saved."""
        self._state, self._now = self.worlds.restore(token[0]), copy.deepcopy(token[1])

    def close(self) -> None:
        """Give the engine back; twice is harmless."""
        self.worlds.close()

    def _wanted(self, name: str, ahead: int = 0) -> np.ndarray:
        """(n, ...) of the references at this step, or some steps ahead."""
        return self.clips.at(name, self._now.clip, self._now.step + ahead)


class _Following:
    """What episodes have come to, (n, ...) each; a deep copy is a copy."""

    def __init__(self, n: int, motors: int) -> None:
        self.clip, self.first, self.step = np.zeros(n, int), np.zeros(n, int), np.zeros(n, int)
        self.start, self.sent, self.offset = np.zeros((n, motors)), np.zeros((n, motors)), np.zeros((n, motors))
        self.error_m = np.zeros(n)

    def begin(self, k: int, clip: int, first: int, u: np.ndarray) -> None:
        """World k anew."""
        self.clip[k], self.first[k], self.step[k] = clip, first, first
        self.start[k], self.sent[k], self.offset[k], self.error_m[k] = u, u, 0.0, 0.0
