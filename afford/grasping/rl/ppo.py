"""Proximal policy optimisation (Schulman et al. 2017), in the order in which it happens.

The numbers in the comments are those of Huang et al., "The 37 implementation details of proximal policy optimization" (ICLR blog
track 2022, https://iclr-blog-track.github.io/2022/03/25/ppo-implementation-details/); details of Atari and LSTM are left out.
What differs is said where it does: steps that end by a time limit are bootstrapped with the value of the last observation, and
when the policy has moved far enough, an update goes on with the critic alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor, nn

from afford.grasping.rl.advantages import advantages
from afford.grasping.rl.policy import ActorCritic


@dataclass(frozen=True)
class Config:
    """What PPO can be told."""

    updates: int = 100
    """rollouts, each followed by an update"""
    steps: int = 34
    """steps of each environment in a rollout"""
    epochs: int = 6
    """passes over a rollout"""
    minibatches: int = 4
    """parts of a pass"""
    lr: float = 5e-4
    """of Adam"""
    gamma: float = 0.96
    """discount"""
    lam: float = 0.95
    """of generalised advantage estimation"""
    clip: float = 0.2
    """how far the ratio of probabilities may matter"""
    value_weight: float = 0.5
    """of the critic's loss"""
    entropy_weight: float = 0.0
    """of the policy's entropy"""
    max_grad_norm: float = 1.0
    """gradients are scaled down to it"""
    target_kl: float = 0.03
    """beyond it, an update changes the critic only; 0 for never"""
    anneal: bool = True
    """whether lr falls to 0 towards the last update"""


@dataclass(frozen=True, eq=False)
class Moved:
    """What a step of all environments brings: the next observation (n, d), of the next episode where one has ended; the observation
    that this step led to (n, d); reward (n,), terminated (n,), truncated (n,); scalars to note.
    """

    observation: np.ndarray
    reached: np.ndarray
    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    notes: dict[str, float]


class Environments(Protocol):
    """n environments that begin anew by themselves."""

    def reset(self) -> np.ndarray:
        """First observations (n, d)."""
        ...

    def step(self, action: np.ndarray) -> Moved:
        """Act (n, a)."""
        ...


@dataclass(frozen=True, eq=False)
class Rollout:
    """What t steps of n environments showed, flattened to (t n, ...)."""

    observation: Tensor
    action: Tensor
    log_prob: Tensor
    advantage: Tensor
    value: Tensor
    target: Tensor
    notes: dict[str, float]


def learn(envs: Environments, model: ActorCritic, config: Config, optimiser: torch.optim.Optimizer, first: int,
          each: Callable[[int, dict[str, float]], None], until: int | None = None) -> None:  # fmt: skip
    """Train `model` from update `first` on, to the end or before update `until`; `each(update, scalars)` is called after every one.
    Random draws are torch's.
    """
    observation = envs.reset()
    if not model.seen.count:
        model.seen.update(torch.from_numpy(observation))
    for update in range(first, config.updates if until is None else until):
        if config.anneal:  # 4
            for group in optimiser.param_groups:
                group["lr"] = config.lr * (1 - update / config.updates)
        rollout, observation = collect(envs, model, observation, config)  # 1
        scalars = rollout.notes | improve(model, optimiser, rollout, config)
        model.seen.update(rollout.observation)  # continuous control 5, 6: once an update, so that the ratio begins at 1
        each(update, scalars)


def adam(model: nn.Module, lr: float) -> torch.optim.Adam:
    """3: with an epsilon of 1e-5."""
    return torch.optim.Adam([p for p in model.parameters() if p.requires_grad], lr, eps=1e-5)


@torch.no_grad()
def collect(envs: Environments, model: ActorCritic, observation: np.ndarray, config: Config) -> tuple[Rollout, np.ndarray]:
    """Act `steps` times by sampling."""
    rows: list[tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Moved]] = []
    model.eval()
    for _ in range(config.steps):
        seen = torch.from_numpy(observation)
        chosen, value = model(seen)  # continuous control 1, 2: a Gaussian whose spread is a parameter
        action = chosen.sample()  # continuous control 3: components are independent
        moved = envs.step(action.numpy())
        rows.append((seen, action, chosen.log_prob(action), value, model.value(torch.from_numpy(moved.reached)), moved))
        observation = moved.observation
    return _flat(rows, config), observation


def _flat(rows: list[tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Moved]], config: Config) -> Rollout:
    seen, action, log_prob, value, after = (torch.stack(column) for column in zip(*(row[:5] for row in rows), strict=True))
    moved = [row[5] for row in rows]
    reward, terminated, truncated = (np.stack([getattr(one, name) for one in moved])
                                     for name in ("reward", "terminated", "truncated"))  # fmt: skip
    gain = torch.from_numpy(advantages(reward.astype(np.float32), value.numpy(), after.numpy(), terminated,
                                       terminated | truncated, config.gamma, config.lam))  # 5
    columns = (seen, action, log_prob, gain, value, gain + value)
    a, b, c, d, e, f = (column.flatten(0, 1) for column in columns)
    return Rollout(a, b, c, d, e, f, _mean([one.notes for one in moved]))


def improve(model: ActorCritic, optimiser: torch.optim.Optimizer, rollout: Rollout, config: Config) -> dict[str, float]:
    """Several passes over a rollout; scalars of the last minibatch that the policy learned from, and how many passes it did."""
    model.train()
    scalars, passes = dict[str, float](), float(config.epochs)
    for epoch in range(config.epochs):
        for rows in torch.randperm(len(rollout.action)).chunk(config.minibatches):  # 6
            policy, critic, found = losses(model, rollout, rows, config)
            if config.target_kl and found["kl"] > 1.5 * config.target_kl:  # 12: from here on only the critic learns
                passes = min(passes, float(epoch))
            learning = passes == config.epochs
            scalars = found if learning or not scalars else scalars
            optimiser.zero_grad()
            (policy + critic if learning else critic).backward()
            nn.utils.clip_grad_norm_(model.parameters(), config.max_grad_norm)  # 11
            optimiser.step()
    return {**scalars, "epochs": passes}


def losses(model: ActorCritic, rollout: Rollout, rows: Tensor, config: Config) -> tuple[Tensor, Tensor, dict[str, float]]:
    """The losses of policy and critic on a minibatch, weighted, and its scalars."""
    chosen, value = model(rollout.observation[rows])
    moved = chosen.log_prob(rollout.action[rows]) - rollout.log_prob[rows]
    ratio, gain = moved.exp(), rollout.advantage[rows]
    gain = (gain - gain.mean()) / (gain.std() + 1e-8)  # 7
    policy = -torch.min(ratio * gain, ratio.clamp(1 - config.clip, 1 + config.clip) * gain).mean()  # 8
    before, target = rollout.value[rows], rollout.target[rows]
    near = before + (value - before).clamp(-config.clip, config.clip)
    critic = 0.5 * torch.max((value - target) ** 2, (near - target) ** 2).mean()  # 9
    entropy = chosen.entropy().mean()
    kl = (moved.exp() - 1 - moved).mean()  # 12
    scalars = {"policy": policy.item(), "critic": critic.item(), "entropy": entropy.item(), "kl": kl.item()}
    return policy - config.entropy_weight * entropy, config.value_weight * critic, scalars  # 10


def _mean(notes: list[dict[str, float]]) -> dict[str, float]:
    """Of every name, over the steps that noted it."""
    names = sorted({name for one in notes for name in one})
    return {name: float(np.mean([one[name] for one in notes if name in one])) for name in names}
