"""n worlds in which a robot hand follows reference clips with the object present: the environment of the prior.

Observations and actions are those of AffordanceGrasp for the role prior, because its worlds are GraspWorlds.

A reference is a clip in the frame of an episode: the object's centre of mass is above the origin, and the object along x. An
episode rotates and shifts the clip to the place of the object. The clip has no fixed place along the object: the hand begins
anywhere along it, and a displacement of the hand on its way displaces the reference. A policy therefore learns to descend where
the hand is. Clips of recorded grasps (`fixed`) have one place: they are not shifted, and their expert pulls the hand back to it.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from afford.common.arrays import namespace, to_numpy
from afford.grasping.env.actions import turned
from afford.grasping.env.arrays import NUMPY, Arrays
from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.flight_recorder import FlightRecorder
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.rotations import yaw_matrix
from afford.grasping.env.step_result import StepResult
from afford.grasping.env.task import Task
from afford.grasping.hand.kinematics import commanded_columns
from afford.grasping.imitation.tracking import (
    FIELDS,
    FINAL_TOLERANCE_M,
    KEYPOINTS,
    REWARDS,
    ReferenceClips,
    Tracker,
    Tracking,
    imitation_rewards,
    tracking_failed,
)
from afford.grasping.sim.engine import CONTROL_S, State
from afford.grasping.sim.scene import Physics
from afford.grasping.sim.scripted import Aim
from schemas.hand import HandModel, HandReference

POINTS = ("level_1_m", "level_2_m", "tips_m", KEYPOINTS)


@dataclass(frozen=True)
class GraspImitationConfig:
    """Configuration of the worlds. ValueError for an unknown value."""

    engine: str = "mujoco"
    """mujoco, bullet or warp"""
    physics: Physics = field(default_factory=Physics)
    """rate and accuracy of the physics"""
    reward: str = "paper"
    """set of reward terms: paper or code (tracking.py)"""
    steps: int = 40
    """control steps of an episode; a shorter clip holds its last frame"""
    lift_m: float = 0.20
    """height to which the clips lift"""
    xy_m: float = 0.05
    """largest distance of the object from the origin, along x and along y"""
    shift_m: float = 0.0
    """largest shift of a clip along the object, both ways"""
    fixed: tuple[str, ...] = ()
    """names of clips with a place of their own along the object"""
    astray: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """standard deviations of the start from that of the clip: m of the wrist, rad of the wrist, rad of the fingers"""
    tolerance_m: float = FINAL_TOLERANCE_M
    """mean error of a level from which an episode fails"""
    threads: int = 1
    """threads that compute worlds"""
    device: str = "cpu"
    """cpu; or cuda or cuda:N with the engine warp"""

    def __post_init__(self) -> None:
        if self.reward not in REWARDS:
            raise ValueError(f"reward: expected {' or '.join(REWARDS)}, got {self.reward!r}")


class GraspImitationWorlds:
    """n worlds, each with an object and the clips that grasp it (step_result.BatchedWorlds)."""

    def __init__(self, hand: HandModel, tasks: Sequence[Task], references: Sequence[HandReference], config: GraspImitationConfig,
                 alone: bool = False, recorder: FlightRecorder | None = None, arrays: Arrays = NUMPY) -> None:  # fmt: skip
        """Build the worlds. A world draws from all clips of its object; with `alone`, world k follows clip k only.

        `arrays` is the library of states, observations and rewards (GraspWorlds).

        ValueError for an object that no clip grasps, clips of another hand, or clips without an object.
        """
        self.hand, self.config, self.clips = hand, config, ReferenceClips(hand, references, arrays.own)
        self._of_motor, self._tracker, self._own = commanded_columns(hand.joints), Tracker(hand, arrays.own), arrays.own
        self._starts = np.stack([self._steps(one) for one in self.clips.references])
        self._fixed = np.array([one.name in config.fixed for one in self.clips.references])
        self._u, self._free = arrays.own(self._starts), arrays.own(~self._fixed)
        start = tuple(self._starts[0, 0].tolist())
        self.grasping = GraspWorlds(hand, tasks, GraspEnvConfig(
            engine=config.engine, physics=config.physics, base="prior", posture=start, role="prior", start="anywhere",
            steps=config.steps, lift_m=config.lift_m, xy_m=config.xy_m, threads=config.threads, device=config.device),
            recorder, arrays)  # fmt: skip
        self._of_world = [[k] if alone else _clips_of(one, self.clips.references) for k, one in enumerate(tasks)]
        n = len(tasks)
        self._now = _EpisodeState(*map(arrays.own, (np.zeros(n, int), np.zeros(n, int), *np.zeros((3, n, 3)))))

    @property
    def motors(self) -> int:
        """Width of an action."""
        return self.grasping.motors

    @property
    def width(self) -> int:
        """Width of an observation."""
        return self.grasping.width

    def reset(self, which: Sequence[int], rngs: Sequence[np.random.Generator]) -> None:
        """Begin episodes in worlds `which`: draw a clip, the pose of the object, and the shift along it."""
        drawn, starts = list[tuple[int, np.ndarray, float]](), list[tuple[np.ndarray, Aim, tuple[float, ...]]]()
        for k in which:
            rng, config = rngs[k], self.config
            clip = self._of_world[k][int(rng.integers(len(self._of_world[k])))]
            yaw, origin = rng.uniform(-np.pi / 2, np.pi / 2), np.append(rng.uniform(-config.xy_m, config.xy_m, 2), 0.0)
            shift = rng.uniform(-config.shift_m, config.shift_m) * (not self._fixed[clip])
            drawn.append((clip, origin, shift))
            pose = _moved(self.clips.references[clip].object_pose[0], yaw, origin)
            posture = self._starts[clip, 0] + _astray(config.astray, self.motors, rng)
            posture[0] += shift
            starts.append((pose, Aim(origin, yaw), tuple(posture.tolist())))
        if drawn:
            self._now.begin(*map(self._own, (np.array(which), *(np.array(column) for column in zip(*drawn, strict=True)))))
            self.grasping.begin(which, *zip(*starts, strict=True))

    def step(self, action: np.ndarray, rngs: Sequence[np.random.Generator]) -> StepResult:
        """Apply actions (n, m) for one control step. ValueError for actions that are not finite."""
        now = self._now
        out = self.grasping.step(action, rngs)
        now.step = now.step + 1
        tracking = self.tracking()
        levels, xp = (tracking.level_1_m, tracking.level_2_m, self._tips_m()), namespace(tracking.wrist_m)
        now.error_m += xp.stack([each.mean(axis=1) for each in levels], axis=1)
        terms = imitation_rewards(self.config.reward, tracking)
        fails = tracking_failed(tracking, self.config.tolerance_m, now.step * CONTROL_S) | out.terminated
        return StepResult(xp.stack(list(terms.values())).sum(axis=0), fails, out.truncated & ~fails, terms, out.success)

    def expert(self) -> np.ndarray:
        """(n, m) action towards the reference a step ahead.

        Along the object it makes the move of the reference from any place, unless the clip is fixed.
        """
        after, before = self._u_at(1), self._u_at(0)
        action = self.grasping.towards(self._placed(after))
        along = ((after - before)[:, 0] / self.grasping.rates[0, 0]).clip(-1, 1)
        action[:, 0] = namespace(action).where(self._free[self._now.clip], along, action[:, 0])
        return action

    def tracking(self) -> Tracking:
        """Current tracking errors."""
        return self._tracker.compare(self.state(), {name: self._reference(name) for name in FIELDS})

    def observe(self) -> np.ndarray:
        """(n, width) float32 observations of AffordanceGrasp for the role prior."""
        return self.grasping.observe()

    def report(self) -> dict[str, np.ndarray]:
        """(n,) figures of episodes that end now: mean errors of both levels and of the fingertips, and those of AffordanceGrasp."""
        mean = to_numpy(self._now.error_m / self._now.step.clip(min=1)[:, None])
        errors = {name: mean[:, k] for k, name in enumerate(("level_1_m", "level_2_m", "tips_error_m"))}
        return errors | self.grasping.report()

    def state(self) -> State:
        """State of all worlds. RuntimeError before the first reset."""
        return self.grasping.state()

    def save(self) -> Any:
        """Snapshot of the state that the next step depends on, without the caller's generators."""
        return self.grasping.save(), copy.deepcopy(self._now)

    def restore(self, token: Any) -> None:
        """Return to a snapshot."""
        self.grasping.restore(token[0])
        self._now = copy.deepcopy(token[1])

    def close(self) -> None:
        """Release the engine; a second call does nothing."""
        self.grasping.close()

    def _steps(self, one: HandReference) -> np.ndarray:
        """(steps + 1, m) motor joints of a clip at control steps, in the frame of an episode; the last frame is held."""
        rows = np.round(np.arange(self.config.steps + 1) * CONTROL_S * one.rate_hz).astype(int).clip(max=len(one.q) - 1)
        found: np.ndarray = one.q[rows][:, self._of_motor]
        return found

    def _u_at(self, ahead: int) -> np.ndarray:
        """(n, m) motor joints of the clips some steps ahead, in the frame of the episode, without the shift."""
        found: np.ndarray = self._u[self._now.clip, (self._now.step + ahead).clip(max=self.config.steps)]
        return found

    def _placed(self, u: np.ndarray) -> np.ndarray:
        """(n, m) motor joints in the frame of the episode -> shifted, in the world."""
        yaw, out = self.grasping.episode.yaw, u + 0.0
        out[:, :3] += self._now.shift
        out = turned(out, yaw)
        out[:, :3] += self._now.origin
        out[:, 3] += yaw
        return out

    def _reference(self, name: str) -> np.ndarray:
        """(n, ...) field of the references at this step, in the world."""
        now, turn, xp = self._now, yaw_matrix(self.grasping.episode.yaw), namespace(self.grasping.episode.yaw)
        rows = self.clips.at(name, now.clip, now.step)
        if name in POINTS:
            return (rows + now.shift[:, None]) @ turn.swapaxes(1, 2) + now.origin[:, None]
        if name == "palm_twist":
            found: np.ndarray = xp.einsum("nij,nkj->nki", turn, rows.reshape(-1, 2, 3)).reshape(-1, 6)
            return found
        if name == "T_world_palm":
            R, place = turn @ rows[:, :3, :3], xp.einsum("nij,nj->ni", turn, rows[:, :3, 3] + now.shift) + now.origin
            rows[:, :3, :3], rows[:, :3, 3] = R, place
            return rows
        return rows

    def _tips_m(self) -> np.ndarray:
        """(n, f) errors of the fingertips."""
        tips = self.state().tips
        found: np.ndarray = namespace(tips).linalg.norm(tips - self._reference("tips_m"), axis=2)
        return found


@dataclass
class _EpisodeState:
    """Progress of the running episodes, arrays of (n, ...). `copy.deepcopy` makes an independent copy."""

    clip: np.ndarray
    step: np.ndarray
    origin: np.ndarray
    shift: np.ndarray
    """(n, 3) shift of the clip, in the frame of the episode"""
    error_m: np.ndarray
    """(n, 3) sum of errors so far"""

    def begin(self, which: np.ndarray, clip: np.ndarray, origin: np.ndarray, shift_m: np.ndarray) -> None:
        """Start episodes of worlds `which` (k,)."""
        self.clip[which], self.step[which], self.origin[which], self.error_m[which] = clip, 0, origin, 0.0
        self.shift[which], self.shift[which, 0] = 0.0, shift_m


def _clips_of(one: Task, references: Sequence[HandReference]) -> list[int]:
    found = [k for k, clip in enumerate(references) if clip.object_name == one.body.name and len(clip.object_pose)]
    if not found:
        raise ValueError(f"references: no clip grasps {one.body.name}; pass a clip that grasps {one.body.name}")
    return found


def _moved(pose: np.ndarray, yaw: float, origin: np.ndarray) -> np.ndarray:
    """(7,) pose, rotated about the vertical and shifted."""
    turn = Rotation.from_euler("z", yaw)
    return np.concatenate([turn.apply(np.array(pose[:3])) + origin, (turn * Rotation.from_quat(pose[3:])).as_quat()])


def _astray(by: tuple[float, float, float], motors: int, rng: np.random.Generator) -> np.ndarray:
    found: np.ndarray = rng.normal(size=motors) * np.repeat(by, [3, 3, motors - 6])
    return found
