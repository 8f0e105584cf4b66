"""n grasps at once: worlds, their episodes, their rewards. Environments (env.py, vector.py) are this, in gymnasium's words.

20 actions a second, 60 with action_mode=paper. An episode ends early (terminated) when the object is beyond reach; it is cut off
(truncated) after `steps`. Everything random in an episode comes from the generator that its reset is given; what varies between
worlds comes from `seed`.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np

from afford.grasping.env import act, base, wrench
from afford.grasping.env.config import Config
from afford.grasping.env.happened import Happened
from afford.grasping.env.measures import Measures, measure
from afford.grasping.env.metrics import Log
from afford.grasping.env.observe import Now, blocks, observe
from afford.grasping.env.reward import rewards, weights
from afford.grasping.env.scenery import Episode, scenery
from afford.grasping.env.task import Task, placed
from afford.grasping.hand.kinematics import command_limits, commanded_columns
from afford.grasping.sim.engine import CONTROL_S, State
from afford.grasping.sim.rest_poses import dropped_rest_poses, placed_rest_pose
from afford.grasping.sim.scene import Scene, Sensing, centre, hold_command, randomize_physics, sensing
from afford.grasping.sim.scripted import Aim, aim_along_axis, aim_at_part
from afford.grasping.sim.worlds import world_batch
from schemas.hand import HandModel

LOST_M = 0.5
"""the object is beyond reach when it has moved so far along the table"""
PUSH_S, PUSH_RAISED_M, PUSH_CHANCE = 0.05, 0.03, 0.25
"""a push takes a twentieth of a second; while the object is raised by 3 cm, one twentieth of a second in four begins with one"""
DROPS = 8
"""resting poses of each object that was dropped"""


class Grasping:
    """n worlds, each with its own task. `observe` and `report` speak of now."""

    def __init__(self, hand: HandModel, tasks: Sequence[Task], config: Config) -> None:
        """ValueError for what Config does not know."""
        self.config, self.tasks = config, tuple(tasks)
        self.blocks, self.weights = blocks(config.layout, config.role), weights(config.reward, config.weights)
        self.scenes = [_scene(hand, one, config, k) for k, one in enumerate(self.tasks)]
        self.sensing = [_sensing(config, k) for k in range(len(self.tasks))]
        self.scenery = scenery(hand, self.tasks)
        self.worlds = world_batch(config.engine, self.scenes, config.threads, config.processes, config.device)
        self._of_motor = commanded_columns(hand.joints)
        self._limits = command_limits(hand.joints)
        self.rates = (wrench.table(self._limits) if config.action_mode == "paper"
                      else act.table(act.RATES[config.base], len(self._limits)))  # fmt: skip
        self._resting: dict[Any, list[np.ndarray]] = {}
        self._now = _Running(len(self.tasks), config.steps, len(self._limits), max(one.latency_steps for one in self.sensing))
        self._state: State | None = None
        self._measured: Measures | None = None

    @property
    def motors(self) -> int:
        """Width of an action."""
        return len(self._limits)

    @property
    def width(self) -> int:
        """Of an observation."""
        return sum(block.width for block in self.blocks)

    def reset(self, which: Sequence[int], rngs: Sequence[np.random.Generator]) -> None:
        """Begin episodes in worlds `which`, from the generators of all worlds."""
        poses, aims = list[np.ndarray](), list[Aim]()
        for k in which:
            poses.append(self._pose(k, rngs[k]))
            aims.append(self._aim(k, poses[-1], rngs[k]))
        self._begin(which, poses, aims)

    def begin(self, k: int, pose: np.ndarray, aim: Aim, posture: Sequence[float]) -> None:
        """Begin an episode of world k with its object at the pose (7,), the hand over an aim in a posture (m,), see base.begin."""
        self._begin([k], [pose], [aim], posture)

    def step(self, action: np.ndarray, rngs: Sequence[np.random.Generator]) -> Happened:
        """Act (n, m); worlds whose episode is over go on, until they are reset. ValueError for actions that are not finite."""
        now, rows = self._now, np.arange(len(self.tasks))
        action = act.checked(action, (len(rows), self.motors))
        at = now.step.clip(max=self.config.steps - 1)
        u, now.offset = self._command(action, now.base[rows, at])
        now.sent = np.concatenate([u[:, None], now.sent[:, :-1]], axis=1)
        now.action = action.clip(-1, 1)
        self._push(rngs)
        latency = [one.latency_steps for one in self.sensing]
        self._state = self.worlds.step(now.sent[rows, latency], self.config.control_s)
        measured = self._measured = self._measure()
        now.log.note(measured, at)
        now.step = now.step + 1
        terms = rewards(self.weights, measured)
        lost = measured.away_m > LOST_M
        late = (now.step >= self.config.steps) & ~lost
        return Happened(np.sum(list(terms.values()), axis=0), terms, lost, late, now.log.success.copy())

    def measures(self) -> Measures:
        """What rewards look at."""
        if self._measured is None:
            self._measured = self._measure()
        return self._measured

    def observe(self) -> np.ndarray:
        """(n, width) float32."""
        return observe(self.blocks, self.now())

    def now(self) -> Now:
        """What observations are cut from."""
        now, state = self._now, self.state()
        lag = (now.sent[:, 0] - state.q[:, self._of_motor]) / self.rates[:, 0]
        return Now(self.scenery, now.episode, state, self.measures(), now.action, now.offset / self.rates[:, 0], lag,
                   now.step / self.config.steps)  # fmt: skip

    def report(self) -> dict[str, np.ndarray]:
        """How episodes went that end now: metrics.MEANING."""
        return self._now.log.report(self.measures())

    def goal(self) -> np.ndarray:
        """(n, 3) where the objects' centres of mass are to be, world."""
        return self._now.episode.goal.copy()

    def depths(self) -> np.ndarray:
        """(n, steps) m, of the deepest contact after each step; NaN where hand and object do not touch."""
        return self._now.log.depth_m.copy()

    def state(self) -> State:
        """Of all worlds. RuntimeError before the first reset."""
        if self._state is None:
            raise RuntimeError("expected a reset before the first step")
        return self._state

    def script(self) -> np.ndarray:
        """(n, steps, m) targets of the grasp by script, for objects that lie as these did at their reset."""
        return np.stack([base.scripted(scene, aim, self.config.steps, self.config.lift_m, self.config.wait)
                         for scene, aim in zip(self.scenes, self._now.aim, strict=True)])  # fmt: skip

    @property
    def aims(self) -> list[Aim]:
        """Where the hands began and bases go."""
        return list(self._now.aim)

    @property
    def sent(self) -> np.ndarray:
        """(n, m) the targets that motors were given last."""
        return self._now.sent[:, 0]

    @property
    def episode(self) -> Episode:
        """What episodes began with."""
        return self._now.episode

    def towards(self, u: np.ndarray) -> np.ndarray:
        """(n, m) the action that leads to targets (n, m), as far as one step goes."""
        return act.towards(self.rates, self._now.sent[:, 0], u, self._now.episode.yaw)

    def steps_done(self) -> np.ndarray:
        """(n,) of each episode."""
        return self._now.step.copy()

    def correction(self, u: np.ndarray) -> np.ndarray:
        """(n, m) the action after which, as far as one step goes, base and offset together want targets (n, m)."""
        now = self._now
        base = now.base[np.arange(len(u)), now.step.clip(max=self.config.steps - 1)]
        return act.towards(self.rates, base + act.turned(now.offset, now.episode.yaw), u, now.episode.yaw)

    def save(self) -> Any:
        """Everything that the next step depends on, but the generators of the caller."""
        return self.worlds.save(), copy.deepcopy(self._now)

    def restore(self, token: Any) -> None:
        """Back to what was saved."""
        self._state, self._now = self.worlds.restore(token[0]), copy.deepcopy(token[1])
        self._measured = None

    def close(self) -> None:
        """Give the engine back; twice is harmless."""
        self.worlds.close()

    def _measure(self) -> Measures:
        return measure(self.scenery, self._now.episode, self.state(), self._now.action)

    def _command(self, action: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, m) commands of actions (n, m) over what the base (n, m) wants, and how far actions have moved it."""
        now = self._now
        if self.config.action_mode == "paper":
            u = wrench.command(action, self.state().q[:, :6], now.episode.yaw, self._limits)
            return u, action.clip(-1, 1) * self.rates[:, 0]
        return act.command(base, act.moved(self.rates, now.offset, action), now.episode.yaw, self._limits)

    def _begin(self, which: Sequence[int], poses: Sequence[np.ndarray], aims: Sequence[Aim],
               posture: Sequence[float] = ()) -> None:  # fmt: skip
        config, posture = self.config, posture or self.config.posture
        q = [base.begin(self.scenes[k], aim, posture) for k, aim in zip(which, aims, strict=True)]
        for k, pose, aim, joints in zip(which, poses, aims, q, strict=True):
            scene = self.scenes[k]
            self._now.begin(k, aim, centre(scene.body, pose), config.lift_m, hold_command(scene, joints),
                            base.commands(config.base, scene, aim, config.steps, config.lift_m, posture, config.wait))  # fmt: skip
        if q:
            self.worlds.reset(np.stack(q), np.stack(poses), which)
        self._state, self._measured = self.worlds.state(), None

    def _aim(self, k: int, pose: np.ndarray, rng: np.random.Generator) -> Aim:
        """Where the hand of world k begins and its base goes."""
        if self.config.start == "part":
            return aim_at_part(self.scenes[k], pose, self.tasks[k].hold)
        return aim_along_axis(self.scenes[k], pose, rng.uniform(-self.config.start_m, self.config.start_m))

    def _pose(self, k: int, rng: np.random.Generator) -> np.ndarray:
        """Where the object of world k begins."""
        scene = self.scenes[k]
        key = (id(scene.body), scene.physics) if self.config.poses == "flat" else k  # what is laid down lies alike in equal worlds
        if key not in self._resting:
            self._resting[key] = self._rest(k)
        lying = self._resting[key][rng.integers(len(self._resting[key]))]
        xy, yaw = rng.uniform(-self.config.xy_m, self.config.xy_m, 2), rng.uniform(-np.pi, np.pi)
        return placed(self.tasks[k].body, lying, xy, yaw)

    def _rest(self, k: int) -> list[np.ndarray]:
        world, scene = self.worlds.alone(k), self.scenes[k]
        if self.config.poses == "flat":
            return [placed_rest_pose(world, scene)]
        return dropped_rest_poses(world, scene, int(np.random.default_rng([self.config.seed, k]).integers(2**31)), DROPS)

    def _push(self, rngs: Sequence[np.random.Generator]) -> None:
        if not self.config.push_n:
            return
        raised = self.scenery.centre(self.state())[:, 2] - self._now.episode.origin[:, 2] > PUSH_RAISED_M
        for k in np.flatnonzero(raised).tolist():
            if rngs[k].random() < PUSH_CHANCE * self.config.control_s / CONTROL_S:
                direction = rngs[k].normal(size=3)
                self.worlds.push(self.config.push_n * direction[None] / np.linalg.norm(direction), PUSH_S, [k])


class _Running:
    """What episodes have come to, (n, ...) each; a deep copy is a copy."""

    def __init__(self, n: int, steps: int, motors: int, latency: int) -> None:
        self.step = np.zeros(n, int)
        self.aim = [Aim(np.zeros(3), 0.0)] * n
        self.episode = Episode(np.zeros((n, 3)), np.zeros(n), np.zeros((n, 3)))
        self.base, self.sent = np.zeros((n, steps, motors)), np.zeros((n, 1 + latency, motors))
        self.offset, self.action = np.zeros((n, motors)), np.zeros((n, motors))
        self.log = Log(n, steps)

    def begin(self, k: int, aim: Aim, origin: np.ndarray, lift_m: float, u: np.ndarray, commands: np.ndarray) -> None:
        """World k anew."""
        self.step[k], self.aim[k], self.sent[k], self.base[k] = 0, aim, u, commands
        self.offset[k] = self.action[k] = 0.0
        self.episode.origin[k], self.episode.yaw[k], self.episode.goal[k] = origin, aim.yaw, origin + (0, 0, lift_m)
        self.log.clear(np.array([k]))


def _scene(hand: HandModel, one: Task, config: Config, k: int) -> Scene:
    scene = Scene(hand, one.body, config.physics, "wrench" if config.action_mode == "paper" else "servo")
    return randomize_physics(scene, config.seed + k) if config.randomise else scene


def _sensing(config: Config, k: int) -> Sensing:
    return sensing(config.seed + k) if config.randomise else Sensing()
