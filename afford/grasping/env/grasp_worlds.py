"""n grasping worlds that are stepped at once: physics, episodes, rewards. The gymnasium environments (env.py) wrap them.

Control runs at 20 steps per second, or 60 with action_mode=paper. An episode is terminated when the object is out of reach, or
when the world diverged and a recorder keeps its last states, and truncated after `steps`. All randomness of an episode comes from
the generator that its reset is given; differences between worlds come from `seed`.

The same code computes with arrays of numpy, and with tensors on a device (arrays.py). Resets are computed by numpy on the CPU,
world by world, and copied to the device together, since most episodes of a training begin together. A control step waits for the
device once, to find worlds that diverged; pushes, which no training uses, wait as well.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np

from afford.common.arrays import copied, mapped, namespace, number, to_numpy
from afford.grasping.env import actions
from afford.grasping.env.arrays import NUMPY, Arrays
from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.flight_recorder import FlightRecorder, diverged
from afford.grasping.env.measures import EpisodeLog, Measures, measure
from afford.grasping.env.obs_blocks import Snapshot, obs_blocks, observe
from afford.grasping.env.reward import reward_weights, rewards
from afford.grasping.env.scenery import EpisodeFrame, build_scenery
from afford.grasping.env.step_result import StepResult
from afford.grasping.env.task import Task, placed_pose
from afford.grasping.hand.kinematics import command_limits, commanded_columns, moving_joints
from afford.grasping.sim.engine import CONTROL_S, DivergedError, State
from afford.grasping.sim.rest_poses import dropped_rest_poses, placed_rest_pose
from afford.grasping.sim.scene import Scene, Sensing, centre, hold_command, randomize_physics, sensing
from afford.grasping.sim.scripted import Aim, aim_along_axis, aim_at_part
from afford.grasping.sim.worlds import world_batch
from schemas.hand import HandModel

LOST_M = 0.5
"""the object is out of reach when it has moved this far along the table"""
PUSH_S, PUSH_RAISED_M, PUSH_CHANCE = 0.05, 0.03, 0.25
"""duration of a push; height of the object from which it is pushed; chance that a twentieth of a second begins with a push"""
DROPS = 8
"""resting poses of each dropped object"""


class GraspWorlds:
    """n worlds, each with its own task."""

    def __init__(self, hand: HandModel, tasks: Sequence[Task], config: GraspEnvConfig,
                 recorder: FlightRecorder | None = None, arrays: Arrays = NUMPY) -> None:  # fmt: skip
        """Build the worlds; `arrays` is the library of all arrays but those of resets and reports.

        ValueError for an unknown layout, role, reward or engine.
        """
        self.config, self.tasks, self._recorder, self.arrays = config, tuple(tasks), recorder, arrays
        self.blocks, self.weights = obs_blocks(config.layout, config.role), reward_weights(config.reward, config.weights)
        self.scenes = [_scene(hand, one, config, k) for k, one in enumerate(self.tasks)]
        self.sensing = [_sensing(config, k) for k in range(len(self.tasks))]
        self.scenery = mapped(build_scenery(hand, self.tasks), arrays.own)
        self.worlds = arrays.worlds(world_batch(config.engine, self.scenes, config.threads, config.processes, config.device))
        self._of_motor, self._rows = arrays.own(commanded_columns(hand.joints)), arrays.own(np.arange(len(self.tasks)))
        limits, latency = command_limits(hand.joints), np.array([one.latency_steps for one in self.sensing])
        self._limits, self._latency = arrays.own(limits), arrays.own(latency)
        self.rates = arrays.own(actions.wrench_table(limits) if config.action_mode == "paper"
                                else actions.rate_table(actions.RATES[config.base], len(limits)))  # fmt: skip
        self._resting: dict[Any, list[np.ndarray]] = {}
        self._now = _EpisodeState(len(self.tasks), config.steps, len(limits), len(moving_joints(hand.joints)), latency.max(),
                                  arrays)  # fmt: skip
        self._state: State | None = None
        self._measured: Measures | None = None

    @property
    def motors(self) -> int:
        """Width of an action."""
        return len(self._limits)

    @property
    def width(self) -> int:
        """Width of an observation."""
        return sum(block.width for block in self.blocks)

    def reset(self, which: Sequence[int], rngs: Sequence[np.random.Generator]) -> None:
        """Begin episodes in worlds `which`, with the generators of all worlds."""
        poses, aims = list[np.ndarray](), list[Aim]()
        for k in which:
            poses.append(self._object_pose(k, rngs[k]))
            aims.append(self._aim(k, poses[-1], rngs[k]))
        if len(which):
            self.begin(which, poses, aims, [self.config.posture] * len(which))

    def begin(self, which: Sequence[int], poses: Sequence[np.ndarray], aims: Sequence[Aim],
              postures: Sequence[Sequence[float]]) -> None:  # fmt: skip
        """Begin episodes of worlds `which`: objects at poses (7,), hands over aims in postures (m,) (actions.py)."""
        config, scenes, which = self.config, [self.scenes[k] for k in which], list(which)
        q = [actions.initial_joints(*each) for each in zip(scenes, aims, postures, strict=True)]
        origin = [centre(scene.body, pose) for scene, pose in zip(scenes, poses, strict=True)]
        u = [hold_command(scene, joints) for scene, joints in zip(scenes, q, strict=True)]
        base = [actions.base_targets(config.base, scene, aim, config.steps, config.lift_m, posture, config.wait)
                for scene, aim, posture in zip(scenes, aims, postures, strict=True)]  # fmt: skip
        self._now.begin(which, aims, np.stack(origin), config.lift_m, np.stack(u), np.stack(base))
        self._now.start_q[which], self._now.start_pose[which] = q, poses
        self.worlds.reset(np.stack(q), np.stack(poses), which)
        self._state, self._measured = self.worlds.state(), None

    def step(self, action: np.ndarray, rngs: Sequence[np.random.Generator]) -> StepResult:
        """Apply actions (n, m) for one control step. Worlds whose episode has ended continue until their reset.

        ValueError for actions of another shape, or that are not finite. DivergedError without a recorder.
        """
        now, rows = self._now, self._rows
        action = self.arrays.checked(action, (len(rows), self.motors))
        xp = namespace(action)
        at = now.step.clip(max=self.config.steps - 1)
        u, now.offset = self._command(action, now.base[rows, at])
        now.sent = xp.concatenate([u[:, None], now.sent[:, :-1]], axis=1)
        now.action = action.clip(-1, 1)
        self._push(rngs)
        self._state = self.worlds.step(now.sent[rows, self._latency], self.config.control_s)
        broken = self._replace_diverged(at)
        measured = self._measured = measure(self.scenery, now.episode, self._state, now.action)
        now.log.record(measured, at)
        now.step = now.step + 1
        terms = rewards(self.weights, measured)
        lost = (measured.away_m > LOST_M) | broken
        late = (now.step >= self.config.steps) & ~lost
        return StepResult(xp.stack(list(terms.values())).sum(axis=0), lost, late, terms, copied(now.log.success))

    def observe(self) -> np.ndarray:
        """(n, width) float32 observations of the current state."""
        return observe(self.blocks, self.snapshot())

    def snapshot(self) -> Snapshot:
        """Current state of all worlds, from which observation blocks are computed."""
        now, state = self._now, self.state()
        lag = (now.sent[:, 0] - state.q[:, self._of_motor]) / self.rates[:, 0]
        return Snapshot(self.scenery, now.episode, state, self.measures(), now.action, now.offset / self.rates[:, 0], lag,
                        number(now.step) / self.config.steps)  # fmt: skip

    def measures(self) -> Measures:
        """Current distances, forces and depths, which rewards are computed from."""
        if self._measured is None:
            self._measured = measure(self.scenery, self._now.episode, self.state(), self._now.action)
        return self._measured

    def report(self) -> dict[str, np.ndarray]:
        """(n,) figures of episodes that end now (measures.METRICS)."""
        return self._now.log.report(self.measures())

    def state(self) -> State:
        """State of all worlds. RuntimeError before the first reset."""
        if self._state is None:
            raise RuntimeError("GraspWorlds: no episode is running; call reset() first")
        return self._state

    def goal(self) -> np.ndarray:
        """(n, 3) goal of the objects' centres of mass, world frame."""
        return copied(self._now.episode.goal)

    def depths(self) -> np.ndarray:
        """(n, steps) m, deepest contact after each step; NaN where hand and object do not touch."""
        return copied(self._now.log.depth_m)

    def steps_done(self) -> np.ndarray:
        """(n,) steps of each episode so far."""
        return copied(self._now.step)

    @property
    def aims(self) -> list[Aim]:
        """Aim of each world: the place over which the hand began, and where its base goes."""
        return list(self._now.aim)

    @property
    def sent(self) -> np.ndarray:
        """(n, m) targets that the motors were sent last."""
        return self._now.sent[:, 0]

    @property
    def episode(self) -> EpisodeFrame:
        """Frames and goals of the episodes."""
        return self._now.episode

    def script(self) -> np.ndarray:
        """(n, steps, m) targets of the scripted grasp, for the objects as they lay at their reset."""
        return np.stack([actions.scripted(scene, aim, self.config.steps, self.config.lift_m, self.config.wait)
                         for scene, aim in zip(self.scenes, self._now.aim, strict=True)])  # fmt: skip

    def towards(self, u: np.ndarray) -> np.ndarray:
        """(n, m) action that moves the targets as far towards targets (n, m) as one step allows."""
        return actions.towards(self.rates, self._now.sent[:, 0], u, self._now.episode.yaw)

    def save(self) -> Any:
        """Snapshot of the state that the next step depends on, without the caller's generators."""
        return self.worlds.save(), copy.deepcopy(self._now)

    def restore(self, token: Any) -> None:
        """Return to a snapshot."""
        self._state, self._now = self.worlds.restore(token[0]), copy.deepcopy(token[1])
        self._measured = None

    def close(self) -> None:
        """Release the engine; a second call does nothing."""
        self.worlds.close()

    def _command(self, action: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n, m) commands of actions (n, m) over the targets of the base (n, m), and the offsets by actions."""
        now = self._now
        if self.config.action_mode == "paper":
            u = actions.wrench_command(action, self.state().q[:, :6], now.episode.yaw, self._limits)
            return u, action.clip(-1, 1) * self.rates[:, 0]
        return actions.rate_command(base, actions.moved(self.rates, now.offset, action), now.episode.yaw, self._limits)

    def _replace_diverged(self, at: np.ndarray) -> np.ndarray:
        """Set diverged worlds back to the start of their episodes, after steps of numbers (n,); (n,) bool, which they are."""
        now, state, xp = self._now, self.state(), namespace(self.state().q)
        if self._recorder is None:
            if not (xp.isfinite(state.q).all() & xp.isfinite(state.body).all()):
                raise DivergedError(self._divergence(state))
            return xp.zeros_like(self._rows, dtype=bool)
        self._recorder.record(state, now.action, at)
        broken = diverged(state)
        if broken.any():
            which = np.flatnonzero(to_numpy(broken)).tolist()
            self.worlds.reset(now.start_q[which], now.start_pose[which], which)
            for k in which:
                body = self.tasks[k].body
                self._recorder.write(k, f"{body.name}/{body.parts[self.tasks[k].hold]}")
                now.sent[k], now.offset[k] = self.arrays.own(hold_command(self.scenes[k], now.start_q[k])), 0.0
            self._state = self.worlds.state()
        return broken

    def _divergence(self, state: State) -> str:
        k, physics = int(to_numpy(diverged(state)).argmax()), self.config.physics
        return (f"{self.tasks[k].body.name}: {self.config.engine} diverged in world {k}; more iterations than "
                f"{physics.iterations} or a rate above {physics.rate_hz} Hz are needed")

    def _aim(self, k: int, pose: np.ndarray, rng: np.random.Generator) -> Aim:
        """Aim of world k, over which the hand begins and to which its base goes."""
        if self.config.start == "part":
            return aim_at_part(self.scenes[k], pose, self.tasks[k].hold)
        return aim_along_axis(self.scenes[k], pose, rng.uniform(-self.config.start_m, self.config.start_m))

    def _object_pose(self, k: int, rng: np.random.Generator) -> np.ndarray:
        """(7,) pose of the object of world k at the start of an episode."""
        scene = self.scenes[k]
        key = (id(scene.body), scene.physics) if self.config.poses == "flat" else k  # flat poses are equal in equal worlds
        if key not in self._resting:
            self._resting[key] = self._resting_poses(k)
        lying = self._resting[key][rng.integers(len(self._resting[key]))]
        xy, yaw = rng.uniform(-self.config.xy_m, self.config.xy_m, 2), rng.uniform(-np.pi, np.pi)
        return placed_pose(self.tasks[k].body, lying, xy, yaw)

    def _resting_poses(self, k: int) -> list[np.ndarray]:
        world, scene = self.worlds.single_world(k), self.scenes[k]
        if self.config.poses == "flat":
            return [placed_rest_pose(world, scene)]
        return dropped_rest_poses(world, scene, int(np.random.default_rng([self.config.seed, k]).integers(2**31)), DROPS)

    def _push(self, rngs: Sequence[np.random.Generator]) -> None:
        """Push raised objects at random."""
        if not self.config.push_n:
            return
        raised = self.scenery.centre(self.state())[:, 2] - self._now.episode.origin[:, 2] > PUSH_RAISED_M
        for k in np.flatnonzero(to_numpy(raised)).tolist():
            if rngs[k].random() < PUSH_CHANCE * self.config.control_s / CONTROL_S:
                direction = rngs[k].normal(size=3)
                self.worlds.push(self.config.push_n * direction[None] / np.linalg.norm(direction), PUSH_S, [k])


class _EpisodeState:
    """Progress of the running episodes, arrays of (n, ...). `copy.deepcopy` makes an independent copy.

    The starts, to which worlds are set back, are arrays of numpy.
    """

    def __init__(self, n: int, steps: int, motors: int, joints: int, latency: int, arrays: Arrays) -> None:
        self._own = own = arrays.own
        self.step = own(np.zeros(n, int))
        self.aim = [Aim(np.zeros(3), 0.0)] * n
        self.episode = mapped(EpisodeFrame(np.zeros((n, 3)), np.zeros(n), np.zeros((n, 3))), own)
        self.base, self.sent = own(np.zeros((n, steps, motors))), own(np.zeros((n, 1 + latency, motors)))
        self.offset, self.action = own(np.zeros((n, motors))), own(np.zeros((n, motors)))
        self.start_q, self.start_pose = np.zeros((n, joints)), np.zeros((n, 7))
        self.log = EpisodeLog(n, steps, own)

    def begin(self, which: Sequence[int], aims: Sequence[Aim], origin: np.ndarray, lift_m: float, u: np.ndarray,
              base: np.ndarray) -> None:  # fmt: skip
        """Start episodes of worlds `which` (k,), with arrays of numpy (k, ...)."""
        for k, aim in zip(which, aims, strict=True):
            self.aim[k] = aim
        own, at, episode = self._own, self._own(np.array(which)), self.episode
        self.step[at], self.sent[at], self.base[at] = 0, own(u)[:, None], own(base)
        self.offset[at] = self.action[at] = 0.0
        yaw = np.array([aim.yaw for aim in aims])
        episode.origin[at], episode.yaw[at], episode.goal[at] = own(origin), own(yaw), own(origin + (0, 0, lift_m))
        self.log.clear(at)


def _scene(hand: HandModel, task: Task, config: GraspEnvConfig, k: int) -> Scene:
    scene = Scene(hand, task.body, config.physics, "wrench" if config.action_mode == "paper" else "servo")
    return randomize_physics(scene, config.seed + k) if config.randomise else scene


def _sensing(config: GraspEnvConfig, k: int) -> Sensing:
    return sensing(config.seed + k) if config.randomise else Sensing()
