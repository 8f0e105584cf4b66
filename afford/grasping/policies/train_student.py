"""Train a student by DAgger from a teacher (distillation).

Rounds begin with new episodes and random states that are functions of their number (dagger.py). A checkpoint, every SECTION
rounds, therefore keeps weights, optimizer, curves and the replay buffer, and a training that was killed resumes to the same
weights, bit for bit. The buffer is written first, under the number of the round, and deleted when a newer checkpoint is complete.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from afford.common.arrays import mapped, to_numpy
from afford.common.files import empty_folder
from afford.grasping.env.flight_recorder import FlightRecorder, export_records
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.obs_blocks import block_slices
from afford.grasping.env.rollout import Actor
from afford.grasping.env.scenery import to_frame
from afford.grasping.hand.kinematics import forward_kinematics, joint_limits, points_on_links
from afford.grasping.policies.load_policy import MeanAction
from afford.grasping.policies.student import StudentObserver, StudentSensors, write_student
from afford.grasping.policies.student_obs import StudentObs
from afford.grasping.rl import dagger
from afford.grasping.rl.cloud_policy import CloudConfig, CloudPolicy, paper_config
from afford.grasping.rl.dagger import StudentPolicy
from afford.grasping.rl.estimating_policy import LAYOUT, EstimatingPolicy, MeanNetwork, TeacherCopy
from afford.grasping.rl.ppo import make_optimizer
from afford.grasping.sim.engine import State
from afford.models.loading import device_of
from afford.training.curves import EventWriter
from afford.training.loop import derive_seed
from afford.training.state import TrainingState, load_checkpoint, resume, save_checkpoint
from schemas.hand import HandModel

SECTION = 5
"""rounds between two checkpoints"""
FINGER_RAD, LOG_FORCE = 0.3, 0.5
"""perturbed states: largest standard deviation of the displacement of a finger joint; that of the logarithm of a contact force"""


class DistillationWorlds(GraspWorlds):
    """Grasping worlds that can be observed in another state than that of their engine."""

    @contextmanager
    def observed_as(self, state: State) -> Iterator[None]:
        """Show this state (numpy, of all n worlds) to all that observe the worlds, inside the block."""
        kept = self._state, self._measured
        self._state, self._measured = mapped(state, self.arrays.own), None
        try:
            yield
        finally:
            self._state, self._measured = kept


def perturbed(state: State, hand: HandModel, rng: np.random.Generator) -> State:
    """Displace the fingers of n hands and scale their contact forces.

    A hand whose motors give way more, as in another engine or on a robot, has such states. Fingertips follow by the hand's
    kinematics; wrist and object stay.
    """
    limits, n = joint_limits(hand.joints), len(state.q)
    q = state.q.copy()
    width = rng.uniform(0, FINGER_RAD, (n, 1))
    q[:, 6:] = (q[:, 6:] + width * rng.standard_normal(q[:, 6:].shape)).clip(*limits[6:].T)
    tips = points_on_links(forward_kinematics(hand.joints, q), hand.fingers.tip_link, hand.fingers.tip_m)
    force = state.force * np.exp(LOG_FORCE * rng.standard_normal((n, state.force.shape[1], 1)))
    return replace(state, q=q, tips=tips, force=force)


class DistillationEnv:
    """n grasping worlds with a teacher: an environment of DAgger (dagger.DaggerEnv). Actions are in the frame of the start."""

    def __init__(self, core: DistillationWorlds, teacher: Actor, sensors: StudentSensors, recorder: FlightRecorder,
                 observed: bool = False) -> None:  # fmt: skip
        """`recorder` is that of the worlds, whose seed is also that of the episodes.

        With `observed`, labels have what the teacher observes after its actions, as EstimatingPolicy learns it.
        """
        self.core, self.teacher, self.seed, self.steps = core, teacher, recorder.seed, core.config.steps
        self.recorder, self.observed = recorder, observed
        self.observer = StudentObserver(core, sensors)
        self._rngs: list[np.random.Generator] = []

    def begin(self, round_: int) -> StudentObs:
        """Reset all worlds; episodes are functions of the seed, the round and the world."""
        n = len(self.core.tasks)
        self.recorder.begin(round_)
        self._rngs = [np.random.default_rng([self.seed, round_, k]) for k in range(n)]
        self.core.reset(range(n), self._rngs)
        self.observer.reseed(int(np.random.default_rng([self.seed, round_]).integers(2**62)))
        return self.observer.observe()

    def label(self) -> np.ndarray:
        """(n, m) actions of the teacher; with `observed`, (n, m + e)."""
        action = self.observer.to_start_frame(self.teacher.act(self.core))
        return np.concatenate([action, self._observation()], axis=1) if self.observed else action

    def perturbed(self, rng: np.random.Generator) -> tuple[StudentObs, np.ndarray]:
        """Observations of perturbed states, and the actions (n, m) of the teacher, which observes the same states."""
        state = mapped(self.core.state(), to_numpy)
        with self.core.observed_as(perturbed(state, self.core.scenery.hand, rng)):
            return self.observer.observe(), self.label()

    def step(self, action: np.ndarray) -> StudentObs:
        """Apply the actions (n, m)."""
        self.core.step(self.observer.from_start_frame(action), self._rngs)
        return self.observer.observe()

    def report(self) -> dict[str, np.ndarray]:
        """(n,) figures of the episodes that end now."""
        return self.core.report()

    def _observation(self) -> np.ndarray:
        """(n, e) frame of the episode in that of the start, and the teacher's numbers after those of the robot."""
        start, episode = self.observer.start, mapped(self.core.episode, to_numpy)
        origin, yaw = to_frame(episode.origin - start.origin, start.yaw), episode.yaw - start.yaw
        rest = to_numpy(self.core.observe())[:, block_slices(self.core.blocks)["phase"].stop :]
        return np.concatenate([origin, np.cos(yaw)[:, None], np.sin(yaw)[:, None], rest], axis=1)


def train_student(envs: DistillationEnv, size: str, config: dagger.DaggerConfig, folder: Path,
                  progress: Callable[[int, int], None], device: str = "cpu") -> tuple[StudentPolicy, TrainingState]:  # fmt: skip
    """Train a student on `device`; the network, on the CPU, and its curves.

    `folder` holds checkpoint.safetensors, the replay buffer and tensorboard/.
    """
    copy = teacher_copy(envs) if envs.observed else None
    first_look = envs.observer.sensors.first_look
    model = new_student(size, envs.begin(0).robot.shape[1], envs.core.motors, config.seed, copy, first_look).to(device_of(device))
    optimizer = make_optimizer(model, config.lr)
    state = resume(folder, model, optimizer, device)
    events = EventWriter(folder / "tensorboard", state.points)
    buffer = _load_buffer(folder, config.buffer, state.step)

    def on_round(number: int, scalars: dict[str, float]) -> None:
        state.step = number + 1
        state.log("train", scalars | envs.recorder.take_count())
        if state.step % SECTION == 0 or state.step == config.rounds:
            _save(folder, state, events, model, optimizer, buffer)
        progress(state.step, config.rounds)

    dagger.train(envs, model, config, optimizer, buffer, state.step, on_round)
    state.best_step = state.step
    return model.cpu().eval(), state


def teacher_copy(envs: DistillationEnv) -> TeacherCopy:
    """Copy the networks of the teacher. ValueError for a teacher whose actions are not those of networks at these rates."""
    teacher, config = envs.teacher, envs.core.config
    kind = (config.layout, config.action_mode)
    if not isinstance(teacher, MeanAction) or teacher.teacher is None or kind != (LAYOUT, "rate"):
        raise ValueError(f"student: expected a teacher of layout={LAYOUT}, action_mode=rate, got {', '.join(kind)}; "
                         f"give the student a network of its own (head=own)")
    prior = None if teacher.prior is None else MeanNetwork.of(teacher.prior)
    return TeacherCopy(MeanNetwork.of(teacher.teacher), prior, to_numpy(envs.core.rates[:, 0]))


def new_student(size: str, robot: int, action: int, seed: int, copy: TeacherCopy | None = None,
                first_look: bool = True) -> StudentPolicy:  # fmt: skip
    """Create an untrained student, which acts by the copy of a teacher if there is one. ValueError for an unknown size."""
    sizes: Mapping[str, Callable[[int, int], CloudConfig]] = {"small": CloudConfig, "paper": paper_config}
    if size not in sizes:
        raise ValueError(f"size: expected {' or '.join(sizes)}, got {size!r}")
    torch.manual_seed(derive_seed(seed))
    config = sizes[size](robot, action)
    return EstimatingPolicy(config, copy, first_look) if copy else CloudPolicy(config)


def export_student(folder: Path, model: StudentPolicy, sensors: StudentSensors, facts: Mapping[str, Any]) -> Path:
    """Write the student and its TensorBoard curves into folder/out."""
    root = empty_folder(folder / "out")
    write_student(root, model, sensors, facts)
    if (folder / "tensorboard").exists():
        shutil.copytree(folder / "tensorboard", root / "tensorboard")
    export_records(folder, root)
    return root


def _save(folder: Path, state: TrainingState, events: EventWriter, model: StudentPolicy, optimizer: torch.optim.Optimizer,
          buffer: dagger.ReplayBuffer) -> None:  # fmt: skip
    tensors = {str(k): torch.from_numpy(column) for k, column in enumerate(buffer.columns)}
    save_checkpoint(_buffer_file(folder, state.step), tensors, {"count": buffer.count})
    events.append(state.points)
    state.save(folder, model, optimizer)
    for old in folder.glob("moments-*.safetensors"):
        if old != _buffer_file(folder, state.step):
            old.unlink()


def _load_buffer(folder: Path, size: int, step: int) -> dagger.ReplayBuffer:
    buffer = dagger.ReplayBuffer(size)
    if step:
        tensors, words = load_checkpoint(_buffer_file(folder, step))
        buffer.columns, buffer.count = [tensors[str(k)].numpy() for k in range(len(tensors))], words["count"]
    return buffer


def _buffer_file(folder: Path, step: int) -> Path:
    return folder / f"moments-{step}.safetensors"
