"""Train a teacher by PPO as a residual over a frozen prior: a = clip(a_H + a_T, -1, 1), element-wise (AffordDex).

A training is cut into sections of SECTION updates. A section begins with new episodes and random states that are functions of
(seed, section). Weights and optimizer are therefore all that a checkpoint keeps, and a training that was killed resumes from its
last checkpoint to the same weights, bit for bit.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from afford.common.arrays import like
from afford.common.files import empty_folder
from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.device_arrays import arrays_of
from afford.grasping.env.env import AffordanceGraspVector
from afford.grasping.env.flight_recorder import FlightRecorder, export_records
from afford.grasping.env.gym_env import PPOEnvAdapter, VectorEnv
from afford.grasping.env.step_result import StepResult
from afford.grasping.env.task import Task
from afford.grasping.policies.load_policy import ENVIRONMENT, PRIOR, prior_columns
from afford.grasping.rl import policy_files, ppo
from afford.grasping.rl.ppo import ActorCritic, PolicyConfig, PPOConfig, paper_config
from afford.models.loading import device_of
from afford.training.curves import EventWriter
from afford.training.loop import derive_seed
from afford.training.state import TrainingState, resume
from schemas.hand import HandModel

SECTION = 20
"""updates between two checkpoints"""
SIZES: Mapping[str, Callable[[int, int], PolicyConfig]] = {"small": PolicyConfig, "paper": paper_config}
SCALE = 0.1
"""scale of rewards, so that values are near one"""


@dataclass(frozen=True)
class TeacherTrainingConfig:
    """Length and size of the training of a teacher."""

    seed: int
    worlds: int
    size: str
    """small or paper"""
    std: float
    """standard deviation of actions at the start"""
    std_along: float
    """the same of the first action, which moves the hand along the object"""
    ppo: PPOConfig


class FrozenPrior:
    """Frozen prior, which observes a subset of a teacher's observation."""

    def __init__(self, model: ActorCritic, layout: str) -> None:
        """Freeze the model. ValueError for a prior that was trained with observations of another width."""
        self.model = model.eval().requires_grad_(False)
        self._columns = prior_columns(layout, "teacher")
        if model.config.observation != len(self._columns):
            raise ValueError(f"prior: expected observations of width {len(self._columns)} (layout {layout}, role prior), "
                             f"got a prior trained with width {model.config.observation}; train the prior again")

    @torch.no_grad()
    def act(self, obs: np.ndarray) -> np.ndarray:
        """(n, m) float64 actions within -1..1, from a teacher's observations (n, d), in the library of these."""
        own = torch.as_tensor(obs[:, self._columns], device=self.model.device)
        return like(self.model.actions(own).mean.clamp(-1, 1).double(), obs)


class ResidualEnv(PPOEnvAdapter):
    """PPO environments in which the actions are residuals: added to those of a frozen prior, each within -1..1."""

    def __init__(self, envs: VectorEnv, prior: FrozenPrior, seed: int, scale: float = SCALE) -> None:
        super().__init__(envs, seed, scale)
        self._prior = prior
        self._prior_action = np.zeros((0, 0))

    def reset(self) -> np.ndarray:
        """First observations (n, d)."""
        obs = super().reset()
        self._prior_action = self._prior.act(obs)
        return obs

    def step(self, action: np.ndarray) -> StepResult:
        """Add residual actions (n, m) to the prior's, and apply them for one control step."""
        out = super().step((self._prior_action + action.clip(-1, 1)).clip(-1, 1))
        self._prior_action = self._prior.act(out.obs)
        return out


def train_teacher(hand: HandModel, tasks: Sequence[Task], prior: FrozenPrior | None, config: GraspEnvConfig,
                  plan: TeacherTrainingConfig, folder: Path, progress: Callable[[int, int], None],
                  device: str = "cpu") -> tuple[ActorCritic, TrainingState]:  # fmt: skip
    """Train a teacher; the network, on the CPU, and its curves.

    `folder` holds checkpoint.safetensors, tensorboard/ and diverged/. The networks are on `device`. With engine=warp, states,
    observations and rewards are tensors on the device of the worlds.
    """
    recorder = FlightRecorder(folder, config.engine, plan.seed)
    arrays = arrays_of(config.engine, config.device)
    envs = AffordanceGraspVector(plan.worlds, hand, tasks, recorder, arrays, **vars(config))
    try:
        model = new_teacher(plan, envs.core.width, envs.core.motors)
        return model, train_sections(envs, model, prior, plan, recorder, folder, progress, device)
    finally:
        envs.close()


def train_sections(envs: VectorEnv, model: ActorCritic, prior: FrozenPrior | None, plan: TeacherTrainingConfig,
                   recorder: FlightRecorder, folder: Path, progress: Callable[[int, int], None],
                   device: str = "cpu") -> TrainingState:  # fmt: skip
    """Train a network in environments, section by section, from the last checkpoint of the folder; its curves.

    The network is on the CPU afterwards, and evaluates.
    """
    model.to(device_of(device))
    if prior is not None:
        prior.model.to(model.device)
    optimizer = ppo.make_optimizer(model, plan.ppo.lr)
    state = resume(folder, model, optimizer, device)
    events = EventWriter(folder / "tensorboard", state.points)
    while state.step < plan.ppo.updates:
        seed = derive_seed(plan.seed, state.step, 1)  # of world 0; the other worlds follow it
        recorder.begin(state.step)
        adapter = PPOEnvAdapter(envs, seed, SCALE) if prior is None else ResidualEnv(envs, prior, seed)
        _train_section(adapter, model, plan, optimizer, state, progress, recorder)
        events.append(state.points)
        state.save(folder, model, optimizer)
    state.best_step = state.step
    model.cpu().eval()
    return state


def new_teacher(plan: TeacherTrainingConfig, observation: int, action: int) -> ActorCritic:
    """Create an untrained teacher, whose actions are nearly zero. ValueError for an unknown size."""
    if plan.size not in SIZES:
        raise ValueError(f"size: expected {' or '.join(SIZES)}, got {plan.size!r}")
    torch.manual_seed(derive_seed(plan.seed))
    model = ActorCritic(replace(SIZES[plan.size](observation, action), std=plan.std))
    with torch.no_grad():
        model.log_std[0] = math.log(plan.std_along)
    return model


def export_teacher(folder: Path, model: ActorCritic, prior: FrozenPrior | None, config: GraspEnvConfig, seed: int) -> Path:
    """Write the teacher with its prior and the facts of its environment into folder/out."""
    root = empty_folder(folder / "out")
    policy_files.write_policy(root, model, {name: getattr(config, name) for name in ENVIRONMENT} | {"seed": seed})
    if prior is not None:
        policy_files.write_policy(root / PRIOR, prior.model, {"role": "prior", "layout": config.layout})
    if (folder / "tensorboard").exists():
        shutil.copytree(folder / "tensorboard", root / "tensorboard")
    export_records(folder, root)
    return root


def _train_section(envs: PPOEnvAdapter, model: ActorCritic, plan: TeacherTrainingConfig, optimizer: torch.optim.Optimizer,
                   state: TrainingState, progress: Callable[[int, int], None], recorder: FlightRecorder) -> None:  # fmt: skip
    def on_update(update: int, scalars: dict[str, float]) -> None:
        state.step = update + 1
        state.log("train", scalars | {"std": float(model.log_std.detach().exp().mean())} | recorder.take_count())
        progress(state.step, plan.ppo.updates)

    torch.manual_seed(derive_seed(plan.seed, state.step))
    ppo.train(envs, model, plan.ppo, optimizer, state.step, on_update, min(state.step + SECTION, plan.ppo.updates))
