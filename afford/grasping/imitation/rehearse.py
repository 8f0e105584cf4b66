"""n hands that follow references with the object there: what a prior learns from. It sees what AffordanceGrasp shows to a prior,
and its actions mean the same, because an AffordanceGrasp is what it acts in.

A reference is a clip in the frame of an episode: the object's centre of mass above the origin, the object along x. An episode
turns and shifts it to where the object lies. Along the object the reference has no place of its own: the hand begins anywhere
along it, and who moves the hand along on its way moves the reference. So what is learned goes down where the hand is.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.act import turned
from afford.grasping.env.config import Config
from afford.grasping.env.core import Grasping
from afford.grasping.env.happened import Happened
from afford.grasping.env.scenery import about_z
from afford.grasping.env.task import Task
from afford.grasping.hand.kinematics import commanded_columns
from afford.grasping.imitation.clips import Clips
from afford.grasping.imitation.imitation import REWARDS, STRICT_M, Tracking, failed, rewards
from afford.grasping.imitation.track import FIELDS, Tracker
from afford.grasping.sim.engine import CONTROL_S, State, check_stage_engine
from afford.grasping.sim.scene import Physics
from afford.grasping.sim.scripted import Aim
from schemas.hand import HandModel, HandReference

POINTS = ("level_1_m", "level_2_m", "tips_m")


@dataclass(frozen=True)
class Rehearsal:
    """What rehearsing can be told."""

    engine: str = "mujoco"
    """mujoco or bullet"""
    physics: Physics = field(default_factory=Physics)
    """how carefully worlds are computed"""
    reward: str = "paper"
    """paper or code (imitation.py)"""
    steps: int = 40
    """control steps of an episode; a clip that ends before is held"""
    lift_m: float = 0.20
    """how high the clips lift"""
    xy_m: float = 0.05
    """how far from the origin the object lies, along x and y"""
    shift_m: float = 0.0
    """how far along the object the clip is shifted, both ways"""
    astray: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """standard deviations of the hand's beginning beside the clip's: m of the wrist, rad of the wrist, rad of the fingers"""
    tolerance_m: float = STRICT_M
    """mean error of a level from which an episode fails"""
    threads: int = 1
    """that compute worlds"""

    def __post_init__(self) -> None:
        check_stage_engine(self.engine)
        if self.reward not in REWARDS:
            raise ValueError(f"reward: expected {' or '.join(REWARDS)}, got {self.reward!r}")


class Rehearsing:
    """n worlds, each with an object and the clips that grasp it. A core, as Grasping and Imitating are."""

    def __init__(self, hand: HandModel, tasks: Sequence[Task], references: Sequence[HandReference], config: Rehearsal,
                 alone: bool = False) -> None:  # fmt: skip
        """A world draws from all clips of its object; `alone`, world k follows clip k only. ValueError for an object that no clip
        grasps, clips of another hand, or clips without an object.
        """
        self.hand, self.config, self.clips = hand, config, Clips(hand, references)
        self._of_motor, self._tracker = commanded_columns(hand.joints), Tracker(hand)
        self._u = [self._steps(one) for one in self.clips.references]
        start = tuple(self._u[0][0].tolist())
        self.grasping = Grasping(hand, tasks, Config(
            engine=config.engine, physics=config.physics, base="prior", posture=start, role="prior", start="anywhere",
            steps=config.steps, lift_m=config.lift_m, xy_m=config.xy_m, threads=config.threads))  # fmt: skip
        self._of_world = [[k] if alone else _clips_of(one, self.clips.references) for k, one in enumerate(tasks)]
        n = len(tasks)
        self._now = _Rehearsed(np.zeros(n, int), np.zeros(n, int), np.zeros((n, 3)), np.zeros((n, 3)))

    @property
    def motors(self) -> int:
        """Width of an action."""
        return self.grasping.motors

    @property
    def width(self) -> int:
        """Of an observation."""
        return self.grasping.width

    def reset(self, which: Sequence[int], rngs: Sequence[np.random.Generator]) -> None:
        """Begin in worlds `which`: a clip, where its object lies, how far along it the hand is."""
        for k in which:
            rng, config = rngs[k], self.config
            clip = self._of_world[k][int(rng.integers(len(self._of_world[k])))]
            yaw, origin = rng.uniform(-np.pi / 2, np.pi / 2), np.append(rng.uniform(-config.xy_m, config.xy_m, 2), 0.0)
            shift = rng.uniform(-config.shift_m, config.shift_m)
            self._now.begin(k, clip, origin, shift)
            pose = _moved(self.clips.references[clip].object_pose[0], yaw, origin)
            posture = self._u[clip][0] + _astray(config.astray, self.motors, rng)
            posture[0] += shift
            self.grasping.begin(k, pose, Aim(origin, yaw), tuple(posture.tolist()))

    def step(self, action: np.ndarray, rngs: Sequence[np.random.Generator]) -> Happened:
        """Act (n, m). ValueError for actions that are not finite."""
        now = self._now
        out = self.grasping.step(action, rngs)
        now.step = now.step + 1
        tracking = self.tracking()
        levels = (tracking.level_1_m, tracking.level_2_m, self._tips_m())
        now.error_m += np.stack([each.mean(axis=1) for each in levels], axis=1)
        terms = rewards(self.config.reward, tracking)
        fails = failed(tracking, self.config.tolerance_m, now.step * CONTROL_S) | out.terminated
        return Happened(np.sum(list(terms.values()), axis=0), terms, fails, out.truncated & ~fails, out.success)

    def expert(self) -> np.ndarray:
        """(n, m) the action that leads to the reference a step ahead; along the object it goes as the reference goes, from wherever
        the hand is.
        """
        after, before = self._u_at(1), self._u_at(0)
        action = self.grasping.towards(self._placed(after))
        action[:, 0] = ((after - before)[:, 0] / self.grasping.rates[0, 0]).clip(-1, 1)
        return action

    def tracking(self) -> Tracking:
        """How the hands are beside their references, now."""
        return self._tracker.compare(self.state(), {name: self._wanted(name) for name in FIELDS})

    def observe(self) -> np.ndarray:
        """(n, width) float32: AffordanceGrasp's, of the role prior."""
        return self.grasping.observe()

    def report(self) -> dict[str, np.ndarray]:
        """(n,) of episodes that end now: mean errors of both levels and of the fingertips, and what AffordanceGrasp reports."""
        mean = self._now.error_m / np.maximum(self._now.step, 1)[:, None]
        errors = {name: mean[:, k] for k, name in enumerate(("level_1_m", "level_2_m", "tips_error_m"))}
        return errors | self.grasping.report()

    def state(self) -> State:
        """Of all worlds. RuntimeError before the first reset."""
        return self.grasping.state()

    def save(self) -> Any:
        """Everything that the next step depends on, but the generators of the caller."""
        return self.grasping.save(), copy.deepcopy(self._now)

    def restore(self, token: Any) -> None:
        """Back to what was saved."""
        self.grasping.restore(token[0])
        self._now = copy.deepcopy(token[1])

    def close(self) -> None:
        """Give the engine back; twice is harmless."""
        self.grasping.close()

    def _steps(self, one: HandReference) -> np.ndarray:
        """(steps + 1, m) motors of a clip at control steps, in the frame of an episode; its end is held."""
        rows = np.round(np.arange(self.config.steps + 1) * CONTROL_S * one.rate_hz).astype(int).clip(max=len(one.q) - 1)
        found: np.ndarray = one.q[rows][:, self._of_motor]
        return found

    def _u_at(self, ahead: int) -> np.ndarray:
        """(n, m) in the frame of the episode, but for the shift."""
        steps = (self._now.step + ahead).clip(max=self.config.steps)
        return np.stack([self._u[clip][step] for clip, step in zip(self._now.clip, steps, strict=True)])

    def _placed(self, u: np.ndarray) -> np.ndarray:
        """(n, m) of the frame of the episode -> world."""
        yaw = self.grasping.episode.yaw
        out = turned(u + self._now.shift_u(u.shape[1]), yaw)
        out[:, :3] += self._now.origin
        out[:, 3] += yaw
        return out

    def _wanted(self, name: str) -> np.ndarray:
        """(n, ...) a field of the references now, in the world."""
        now, turn = self._now, about_z(self.grasping.episode.yaw).as_matrix()
        rows = self.clips.at(name, now.clip, now.step)
        if name in POINTS:
            return (rows + now.shift[:, None]) @ turn.swapaxes(1, 2) + now.origin[:, None]
        if name == "palm_twist":
            found: np.ndarray = np.einsum("nij,nkj->nki", turn, rows.reshape(-1, 2, 3)).reshape(-1, 6)
            return found
        if name == "T_world_palm":
            out = rows.copy()
            out[:, :3, :3] = turn @ rows[:, :3, :3]
            out[:, :3, 3] = np.einsum("nij,nj->ni", turn, rows[:, :3, 3] + now.shift) + now.origin
            return out
        return rows

    def _tips_m(self) -> np.ndarray:
        """(n, f) how far fingertips are off."""
        found: np.ndarray = np.linalg.norm(self.state().tips - self._wanted("tips_m"), axis=2)
        return found


@dataclass
class _Rehearsed:
    """What episodes have come to, (n, ...) each; a deep copy is a copy."""

    clip: np.ndarray
    step: np.ndarray
    origin: np.ndarray
    shift: np.ndarray
    """(n, 3) of the clip, in the frame of the episode"""
    error_m: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        self.error_m = np.zeros((len(self.clip), 3))

    def begin(self, k: int, clip: int, origin: np.ndarray, shift_m: float) -> None:
        """World k anew."""
        self.clip[k], self.step[k], self.origin[k], self.error_m[k] = clip, 0, origin, 0.0
        self.shift[k] = shift_m, 0.0, 0.0

    def shift_u(self, motors: int) -> np.ndarray:
        """(n, m) the shift as targets of motors."""
        return np.pad(self.shift, ((0, 0), (0, motors - 3)))


def _clips_of(one: Task, references: Sequence[HandReference]) -> list[int]:
    found = [k for k, clip in enumerate(references) if clip.object_name == one.body.name and len(clip.object_pose)]
    if not found:
        raise ValueError(f"references: expected a clip that grasps {one.body.name}, got none; give each object its clips")
    return found


def _moved(pose: np.ndarray, yaw: float, origin: np.ndarray) -> np.ndarray:
    """(7,) turned about z and shifted."""
    turn = Rotation.from_euler("z", yaw)
    return np.concatenate([turn.apply(np.array(pose[:3])) + origin, (turn * Rotation.from_quat(pose[3:])).as_quat()])


def _astray(by: tuple[float, float, float], motors: int, rng: np.random.Generator) -> np.ndarray:
    found: np.ndarray = rng.normal(size=motors) * np.repeat(by, [3, 3, motors - 6])
    return found
