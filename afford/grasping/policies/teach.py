"""Train a student by DAgger, so that a training that was killed goes on to the same weights, to the bit.

A section is SECTION rounds. Rounds begin with new episodes and random states that are functions of their number (dagger.py), so
that between two sections there is only this to keep: weights, optimiser, curves, and the moments that are remembered. Moments are
written first, under the number of the round, and deleted when a newer checkpoint is safe.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch

from afford.common.files import empty_folder
from afford.grasping.policies import student_files
from afford.grasping.policies.lessons import Lessons
from afford.grasping.policies.student import Senses
from afford.grasping.rl import dagger
from afford.grasping.rl.cloud_policy import CloudConfig, CloudPolicy, paper
from afford.grasping.rl.ppo import adam
from afford.training.curves import EventWriter
from afford.training.loop import derive_seed
from afford.training.state import TrainingState, load_checkpoint, resume, save_checkpoint

SECTION = 5
"""rounds between two checkpoints"""


def train(lessons: Lessons, size: str, config: dagger.Config, folder: Path,
          progress: Callable[[int, int], None]) -> tuple[CloudPolicy, TrainingState]:  # fmt: skip
    """The student and its curves; `folder` keeps checkpoint.safetensors, moments and tensorboard/."""
    model = made(size, lessons.begin(0).robot.shape[1], lessons.core.motors, config.seed)
    optimiser = adam(model, config.lr)
    state = resume(folder, model, optimiser, "cpu")
    events = EventWriter(folder / "tensorboard", state.points)
    buffer = _remembered(folder, config.buffer, state.step)

    def each(number: int, scalars: dict[str, float]) -> None:
        state.step = number + 1
        state.log("train", scalars)
        if state.step % SECTION == 0 or state.step == config.rounds:
            _keep(folder, state, events, model, optimiser, buffer)
        progress(state.step, config.rounds)

    dagger.learn(lessons, model, config, optimiser, buffer, state.step, each)
    state.best_step = state.step
    return model.eval(), state


def made(size: str, robot: int, action: int, seed: int) -> CloudPolicy:
    """A student that has learned nothing. ValueError for a size that is not known."""
    sizes: Mapping[str, Callable[[int, int], CloudConfig]] = {"small": CloudConfig, "paper": paper}
    if size not in sizes:
        raise ValueError(f"size: expected {' or '.join(sizes)}, got {size!r}")
    torch.manual_seed(derive_seed(seed))
    return CloudPolicy(sizes[size](robot, action))


def write(folder: Path, model: CloudPolicy, senses: Senses, facts: Mapping[str, Any]) -> Path:
    """The student, and its curves for TensorBoard."""
    root = empty_folder(folder / "out")
    student_files.write(root, model, senses, facts)
    if (folder / "tensorboard").exists():
        shutil.copytree(folder / "tensorboard", root / "tensorboard")
    return root


def _keep(folder: Path, state: TrainingState, events: EventWriter, model: CloudPolicy, optimiser: torch.optim.Optimizer,
          buffer: dagger.Buffer) -> None:  # fmt: skip
    tensors = {str(k): torch.from_numpy(column) for k, column in enumerate(buffer.columns)}
    save_checkpoint(_moments(folder, state.step), tensors, {"count": buffer.count})
    events.append(state.points)
    state.save(folder, model, optimiser)
    for old in folder.glob("moments-*.safetensors"):
        if old != _moments(folder, state.step):
            old.unlink()


def _remembered(folder: Path, size: int, step: int) -> dagger.Buffer:
    buffer = dagger.Buffer(size)
    if step:
        tensors, words = load_checkpoint(_moments(folder, step))
        buffer.columns, buffer.count = [tensors[str(k)].numpy() for k in range(len(tensors))], words["count"]
    return buffer


def _moments(folder: Path, step: int) -> Path:
    return folder / f"moments-{step}.safetensors"
