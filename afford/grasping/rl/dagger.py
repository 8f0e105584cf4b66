"""DAgger (Ross et al. 2011): the student acts, the teacher labels the visited states with its own actions, the student fits them.

AffordDex likewise uses a first-in first-out buffer, the mean squared error of mean actions, and Adam. Four things differ here:
episodes are finished before learning from them; the teacher acts in a falling share of the worlds in the first rounds (beta of the
original paper); a round has a fixed number of minibatches (AffordDex: 5 passes over the buffer in 4 minibatches, every step); and a
share of the visited states is labelled once more as a perturbed state, which no engine has to reach.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
import torch
from torch import Tensor, nn

from afford.grasping.rl.cloud_policy import CloudPolicy
from afford.grasping.rl.estimating_policy import EstimatingPolicy

Observation = Sequence[np.ndarray]
"""observation of a student, arrays of (n, ...): the robot's own numbers first"""
StudentPolicy = CloudPolicy | EstimatingPolicy


@dataclass(frozen=True)
class DaggerConfig:
    """Hyperparameters of DAgger."""

    rounds: int = 40
    """episodes in every world, each followed by learning"""
    updates: int = 80
    """minibatches of a round"""
    batch: int = 128
    """rows of a minibatch"""
    buffer: int = 9600
    """rows of the replay buffer"""
    led: int = 6
    """rounds over which the share of worlds that the teacher acts in (beta) falls from 1 to 0; 0 for none"""
    perturbed: float = 0.5
    """share of the visited states that are labelled once more, perturbed"""
    lr: float = 1e-3
    """learning rate of Adam; it falls to 0 towards the last round"""
    max_grad_norm: float = 1.0
    """gradients are clipped to this norm"""
    seed: int = 0
    """seed of minibatches, and of the worlds that the teacher acts in"""


class DaggerEnv(Protocol):
    """n worlds with a teacher that labels their states. Actions are those of the student."""

    steps: int
    """steps of an episode"""

    def begin(self, round_: int) -> Observation:
        """Reset all worlds for round `round_`; the same number gives the same episodes."""
        ...

    def label(self) -> np.ndarray:
        """(n, a + e) the teacher's actions in the current states, then what else the student learns (its `loss`)."""
        ...

    def perturbed(self, rng: np.random.Generator) -> tuple[Observation, np.ndarray]:
        """Observations of perturbed states near the current ones, and their labels (n, a + e)."""
        ...

    def step(self, action: np.ndarray) -> Observation:
        """Apply the actions (n, a)."""
        ...

    def report(self) -> dict[str, np.ndarray]:
        """(n,) figures of the episodes that end now."""
        ...


class ReplayBuffer:
    """First-in first-out buffer of observations and their labels."""

    def __init__(self, size: int) -> None:
        self.size, self.columns = size, list[np.ndarray]()
        self.count = 0
        """rows added so far, forgotten ones included"""

    def add(self, *columns: np.ndarray) -> None:
        """Append rows; every column is (n, ...)."""
        if not self.columns:
            self.columns = [np.zeros((self.size, *column.shape[1:]), column.dtype) for column in columns]
        at = (self.count + np.arange(len(columns[0]))) % self.size
        for kept, column in zip(self.columns, columns, strict=True):
            kept[at] = column
        self.count += len(columns[0])

    def sample(self, rng: np.random.Generator, count: int, device: torch.device | None = None) -> list[Tensor]:
        """Sample `count` rows uniformly, with replacement."""
        at = rng.integers(min(self.count, self.size), size=count)
        return [torch.as_tensor(column[at], device=device) for column in self.columns]


def train(envs: DaggerEnv, model: StudentPolicy, config: DaggerConfig, optimizer: torch.optim.Optimizer, buffer: ReplayBuffer,
          first: int, on_round: Callable[[int, dict[str, float]], None]) -> None:  # fmt: skip
    """Train from round `first` to the last; `on_round(round, scalars)` is called after each. Draws depend on the round only."""
    for number in range(first, config.rounds):
        rng = np.random.default_rng([config.seed, number])
        torch.manual_seed(int(rng.integers(2**62)))
        for group in optimizer.param_groups:
            group["lr"] = config.lr * (1 - number / config.rounds)
        scalars = collect_episodes(envs, model, config, buffer, number, rng)
        on_round(number, scalars | update(model, config, optimizer, buffer, rng))


@torch.no_grad()
def collect_episodes(envs: DaggerEnv, model: StudentPolicy, config: DaggerConfig, buffer: ReplayBuffer, number: int,
                     rng: np.random.Generator) -> dict[str, float]:  # fmt: skip
    """Play an episode in every world; mean figures of the worlds in which the student acted, and the teacher's share `led`."""
    model.eval()
    to_device = partial(torch.as_tensor, device=model.device)
    obs = envs.begin(number)
    beta = max(0.0, 1 - number / config.led) if config.led else 0.0
    teacher_acts = np.arange(len(obs[0])) < round(beta * len(obs[0]))
    rng.shuffle(teacher_acts)
    robots = []
    for _ in range(envs.steps):
        label = envs.label()
        buffer.add(*obs, label.astype(np.float32))
        robots.append(obs[0])
        if config.perturbed:
            robots.append(_add_perturbed(envs, config, buffer, rng))
        action = label[:, : model.config.action]
        if not teacher_acts.all():
            action = np.where(teacher_acts[:, None], action, model(*map(to_device, obs)).cpu().numpy())
        obs = envs.step(action)
    model.seen.update(to_device(np.concatenate(robots)))
    report = {name: figure[~teacher_acts & ~np.isnan(figure)] for name, figure in envs.report().items()}
    return {name: float(figure.mean()) for name, figure in report.items() if len(figure)} | {"led": float(teacher_acts.mean())}


def _add_perturbed(envs: DaggerEnv, config: DaggerConfig, buffer: ReplayBuffer, rng: np.random.Generator) -> np.ndarray:
    """Add a share of perturbed states to the buffer; the robots' own numbers there."""
    seen, label = envs.perturbed(rng)
    some = rng.random(len(label)) < config.perturbed
    buffer.add(*(part[some] for part in seen), label[some].astype(np.float32))
    return seen[0][some]


def update(model: StudentPolicy, config: DaggerConfig, optimizer: torch.optim.Optimizer, buffer: ReplayBuffer,
           rng: np.random.Generator) -> dict[str, float]:  # fmt: skip
    """Fit the labels on the minibatches of a round; the mean squared error of actions."""
    model.train()
    errors = []
    for _ in range(config.updates):
        *obs, label = buffer.sample(rng, config.batch, model.device)
        loss, error = model.loss(obs, label)
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), config.max_grad_norm)
        optimizer.step()
        errors.append(error.item())
    return {"error": float(np.mean(errors))}
