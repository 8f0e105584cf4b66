"""Train a teacher that adds to a frozen prior, or to nothing, by PPO.

A training is cut into sections of SECTION updates. A section begins with new episodes and random states that are functions of
(seed, section), so that all there is to keep between two of them are the weights and the optimiser: a training that was killed
goes on from the last section to the same weights, to the bit.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch

from afford.common.files import empty_folder
from afford.grasping.env.config import Config
from afford.grasping.env.env import AffordanceGraspVector
from afford.grasping.env.task import Task
from afford.grasping.env.vector import Learning
from afford.grasping.policies.acting import ENVIRONMENT, PRIOR
from afford.grasping.policies.residual import OverBase, Prior
from afford.grasping.rl import ppo, saved
from afford.grasping.rl.policy import ActorCritic, PolicyConfig, paper
from afford.training.curves import EventWriter
from afford.training.loop import derive_seed
from afford.training.state import TrainingState, resume
from schemas.hand import HandModel

SECTION = 20
"""updates between two checkpoints"""
SIZES: Mapping[str, Callable[[int, int], PolicyConfig]] = {"small": PolicyConfig, "paper": paper}
SCALE = 0.1
"""of rewards, so that values are near one"""


@dataclass(frozen=True)
class Plan:
    """How long, how many at once, how large."""

    seed: int
    worlds: int
    size: str
    """small or paper"""
    std: float
    """spread of actions in the beginning"""
    std_along: float
    """of the first one, which moves the hand along the object"""
    ppo: ppo.Config


def train(hand: HandModel, tasks: Sequence[Task], prior: Prior | None, config: Config, plan: Plan, folder: Path,
          progress: Callable[[int, int], None]) -> tuple[ActorCritic, TrainingState]:  # fmt: skip
    """The teacher and its curves; `folder` keeps checkpoint.safetensors and tensorboard/."""
    envs = AffordanceGraspVector(plan.worlds, hand, tasks, **vars(config))
    try:
        model = made(plan, envs.core.width, envs.core.motors)
        optimiser = ppo.adam(model, plan.ppo.lr)
        state = resume(folder, model, optimiser, "cpu")
        events = EventWriter(folder / "tensorboard", state.points)
        while state.step < plan.ppo.updates:
            _section(OverBase(Learning(envs, _seed(plan, state.step), SCALE), prior), model, plan, optimiser, state, progress)
            events.append(state.points)
            state.save(folder, model, optimiser)
    finally:
        envs.close()
    state.best_step = state.step
    return model.eval(), state


def made(plan: Plan, observation: int, action: int) -> ActorCritic:
    """A teacher that has learned nothing: what it adds is nearly zero. ValueError for a size that is not known."""
    if plan.size not in SIZES:
        raise ValueError(f"size: expected {' or '.join(SIZES)}, got {plan.size!r}")
    torch.manual_seed(derive_seed(plan.seed))
    model = ActorCritic(replace(SIZES[plan.size](observation, action), std=plan.std))
    with torch.no_grad():
        model.log_std[0] = math.log(plan.std_along)
    return model


def write(folder: Path, model: ActorCritic, prior: Prior | None, config: Config, seed: int) -> Path:
    """The teacher, whole: with the prior in it, and what must be known of the environment."""
    root = empty_folder(folder / "out")
    saved.write(root, model, {name: getattr(config, name) for name in ENVIRONMENT} | {"seed": seed})
    if prior is not None:
        saved.write(root / PRIOR, prior.model, {"role": "prior", "layout": config.layout})
    if (folder / "tensorboard").exists():
        shutil.copytree(folder / "tensorboard", root / "tensorboard")
    return root


def _section(envs: OverBase, model: ActorCritic, plan: Plan, optimiser: torch.optim.Optimizer, state: TrainingState,
             progress: Callable[[int, int], None]) -> None:  # fmt: skip
    def each(update: int, scalars: dict[str, float]) -> None:
        state.step = update + 1
        state.log("train", scalars | {"std": float(model.log_std.detach().exp().mean())})
        progress(state.step, plan.ppo.updates)

    torch.manual_seed(derive_seed(plan.seed, state.step))
    ppo.learn(envs, model, plan.ppo, optimiser, state.step, each, min(state.step + SECTION, plan.ppo.updates))


def _seed(plan: Plan, step: int) -> int:
    """Of the first world; others follow it."""
    return derive_seed(plan.seed, step, 1)
