"""Proximal policy optimization (PPO, Schulman et al. 2017) with generalized advantage estimation, in one file.

Numbers in comments refer to Huang et al., "The 37 implementation details of proximal policy optimization" (ICLR blog track 2022,
https://iclr-blog-track.github.io/2022/03/25/ppo-implementation-details/); details of Atari and LSTM are left out.
Two things differ. Steps that end by a time limit are bootstrapped with the value of their final observation. An update whose
policy has moved beyond the target KL divergence continues with the critic alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor, nn
from torch.distributions import Independent, Normal

from afford.common.arrays import like, namespace
from afford.grasping.env.step_result import StepResult

ACTIVATIONS = {"tanh": nn.Tanh, "elu": nn.ELU}


@dataclass(frozen=True)
class PPOConfig:
    """Hyperparameters of PPO."""

    updates: int = 100
    """rollouts, each followed by an update"""
    steps: int = 34
    """steps of each environment in a rollout"""
    epochs: int = 6
    """passes over a rollout"""
    minibatches: int = 4
    """minibatches of a pass"""
    lr: float = 5e-4
    """learning rate of Adam"""
    gamma: float = 0.96
    """discount"""
    gae_lambda: float = 0.95
    """lambda of generalized advantage estimation"""
    clip: float = 0.2
    """clipping range of the probability ratio and of the value"""
    value_weight: float = 0.5
    """weight of the critic's loss"""
    entropy_weight: float = 0.0
    """weight of the policy's entropy"""
    max_grad_norm: float = 1.0
    """gradients are clipped to this norm"""
    target_kl: float = 0.03
    """beyond 1.5 times this divergence an update changes the critic only; 0 for no bound"""
    anneal: bool = True
    """lower the learning rate to 0 towards the last update"""


@dataclass(frozen=True)
class PolicyConfig:
    """Sizes of the actor and critic networks. The fields are keys of policy.json."""

    observation: int
    """width of an observation"""
    action: int
    """width of an action"""
    hidden: tuple[int, ...] = (128, 128)
    """widths of the hidden layers of both networks"""
    activation: str = "tanh"
    """tanh or elu"""
    std: float = 0.5
    """standard deviation of the actions at the start of training"""


def paper_config(observation: int, action: int) -> PolicyConfig:
    """Return the sizes of AffordDex."""
    return PolicyConfig(observation, action, (1024, 1024, 512, 512), "elu", 0.8)


class RunningMeanStd(nn.Module):
    """Normalize observations (n, d) by the running mean and variance of all rows given to `update` (Chan et al. 1979)."""

    mean: Tensor
    var: Tensor
    count: Tensor

    def __init__(self, width: int, clip: float = 5.0) -> None:
        super().__init__()
        self.clip = clip
        self.register_buffer("mean", torch.zeros(width, dtype=torch.float64))
        self.register_buffer("var", torch.ones(width, dtype=torch.float64))
        self.register_buffer("count", torch.zeros((), dtype=torch.float64))

    def update(self, x: Tensor) -> None:
        """Add a batch (n, d) to the statistics."""
        x = x.detach().double()
        n, total = len(x), self.count + len(x)
        delta = x.mean(0) - self.mean
        squares = self.var * self.count + x.var(0, unbiased=False) * n + delta**2 * self.count * n / total
        self.mean += delta * n / total
        self.var.copy_(squares / total)
        self.count.copy_(total)

    def forward(self, x: Tensor) -> Tensor:
        """(n, d) float32 of zero mean and unit variance, clipped to -clip..clip."""
        return ((x - self.mean) / (self.var + 1e-8).sqrt()).float().clamp(-self.clip, self.clip)


class ActorCritic(nn.Module):
    """Actor and critic: two MLPs over normalized observations, and a Gaussian whose spread is a parameter."""

    def __init__(self, config: PolicyConfig) -> None:
        super().__init__()
        self.config = config
        self.seen = RunningMeanStd(config.observation)  # obs_rms; the attribute names are keys of policy.safetensors
        self.actor = mlp((config.observation, *config.hidden, config.action), config.activation, last=0.01)
        self.critic = mlp((config.observation, *config.hidden, 1), config.activation, last=1.0)
        self.log_std = nn.Parameter(torch.full((config.action,), config.std).log())

    @property
    def device(self) -> torch.device:
        """Device of the parameters."""
        return self.log_std.device

    def forward(self, obs: Tensor) -> tuple[Independent, Tensor]:
        """(n, d) -> distribution of actions (n, a), values (n,)."""
        return self.actions(obs), self.value(obs)

    def actions(self, obs: Tensor) -> Independent:
        """Distribution of actions (n, a); a trained policy takes its mean."""
        mean = self.actor(self.seen(obs))
        return Independent(Normal(mean, self.log_std.exp().expand_as(mean)), 1)

    def value(self, obs: Tensor) -> Tensor:
        """(n,) expected discounted return."""
        return self.critic(self.seen(obs))[..., 0]


def mlp(widths: tuple[int, ...], activation: str, last: float) -> nn.Sequential:
    """MLP with orthogonal weights, the last layer scaled by `last`, for small first actions (Andrychowicz et al. 2021)."""
    layers: list[nn.Module] = []
    for n, (before, after) in enumerate(pairwise(widths)):
        linear = nn.Linear(before, after)
        final = n == len(widths) - 2
        nn.init.orthogonal_(linear.weight, last if final else 2**0.5)
        nn.init.zeros_(linear.bias)
        layers += [linear] if final else [linear, ACTIVATIONS[activation]()]
    return nn.Sequential(*layers)


class VecEnv(Protocol):
    """n environments that reset themselves when an episode ends. A result has obs, final_obs, reward and metrics.

    Arrays are numpy's, on the CPU, or tensors on the device of the model, on which PPO computes.
    """

    def reset(self) -> np.ndarray:
        """First observations (n, d)."""
        ...

    def step(self, action: np.ndarray) -> StepResult:
        """Apply the actions (n, a)."""
        ...


@dataclass(frozen=True, eq=False)
class Rollout:
    """Transitions of t steps of n environments, flattened to (t n, ...)."""

    obs: Tensor
    action: Tensor
    log_prob: Tensor
    advantage: Tensor
    value: Tensor
    target: Tensor
    """return that the critic learns: advantage + value"""
    metrics: dict[str, float]


def train(envs: VecEnv, model: ActorCritic, config: PPOConfig, optimizer: torch.optim.Optimizer, first: int,
          on_update: Callable[[int, dict[str, float]], None], until: int | None = None) -> None:  # fmt: skip
    """Train `model` from update `first` to the last one, or up to but excluding update `until`.

    `on_update(update, scalars)` is called after every update. All random draws are torch's.
    """
    obs = envs.reset()
    if not model.seen.count:
        model.seen.update(torch.as_tensor(obs, device=model.device))
    for number in range(first, config.updates if until is None else until):
        if config.anneal:  # 4
            for group in optimizer.param_groups:
                group["lr"] = config.lr * (1 - number / config.updates)
        rollout, obs = collect_rollout(envs, model, obs, config)  # 1
        scalars = rollout.metrics | update(model, optimizer, rollout, config)
        model.seen.update(rollout.obs)  # continuous control 5, 6: once per update, so that the ratio begins at 1
        on_update(number, scalars)


def make_optimizer(model: nn.Module, lr: float) -> torch.optim.Adam:
    """Adam with an epsilon of 1e-5 (3)."""
    return torch.optim.Adam([p for p in model.parameters() if p.requires_grad], lr, eps=1e-5)


@torch.no_grad()
def collect_rollout(envs: VecEnv, model: ActorCritic, obs: np.ndarray, config: PPOConfig) -> tuple[Rollout, np.ndarray]:
    """Sample actions for `config.steps` steps; the rollout, and the observations (n, d) to continue from."""
    model.eval()
    to_device = partial(torch.as_tensor, device=model.device)
    rows = list[tuple[Tensor, ...]]()
    results = list[StepResult]()
    for _ in range(config.steps):
        seen = to_device(obs)
        dist, value = model(seen)  # continuous control 1, 2: a Gaussian whose spread is a parameter
        action = dist.sample()  # continuous control 3: components are independent
        result = envs.step(like(action, obs))
        rows.append((seen, action, dist.log_prob(action), value, model.value(to_device(result.final_obs))))
        results.append(result)
        obs = result.obs
    seen, action, log_prob, value, next_value = (torch.stack(column) for column in zip(*rows, strict=True))
    reward, terminated, done = (to_device(namespace(obs).stack([getattr(one, name) for one in results]))
                                for name in ("reward", "terminated", "done"))  # fmt: skip
    advantage = gae(reward.float(), value, next_value, terminated, done, config.gamma, config.gae_lambda)
    columns = (seen, action, log_prob, advantage, value, advantage + value)
    a, b, c, d, e, f = (column.flatten(0, 1) for column in columns)
    return Rollout(a, b, c, d, e, f, _mean([one.metrics for one in results])), obs


def gae(reward: Tensor, value: Tensor, next_value: Tensor, terminated: Tensor, done: Tensor, gamma: float,
        gae_lambda: float) -> Tensor:  # fmt: skip
    """Compute generalized advantage estimates (5; Schulman et al. 2016), (t, n) of t steps in n environments.

    `value` (t, n) belongs to the observations that were acted on, `next_value` (t, n) to those that followed, before any reset.
    Where `terminated` (t, n), the next value is 0. Where `done` (t, n), terminated or truncated, the next row is another episode.
    """
    td_error = reward + gamma * next_value.masked_fill(terminated, 0) - value  # delta
    advantage = torch.zeros_like(td_error)
    last_gae = torch.zeros_like(td_error[0])
    for t in reversed(range(len(td_error))):
        last_gae = td_error[t] + gamma * gae_lambda * last_gae.masked_fill(done[t], 0)
        advantage[t] = last_gae
    return advantage


def update(model: ActorCritic, optimizer: torch.optim.Optimizer, rollout: Rollout, config: PPOConfig) -> dict[str, float]:
    """Make several passes over a rollout; scalars of the last minibatch that the policy learned from, and its number of passes."""
    model.train()
    scalars, passes = dict[str, float](), float(config.epochs)
    for epoch in range(config.epochs):
        for rows in torch.randperm(len(rollout.action)).to(model.device).chunk(config.minibatches):  # 6
            policy_loss, value_loss, found = losses(model, rollout, rows, config)
            if config.target_kl and found["kl"] > 1.5 * config.target_kl:  # 12: from here on only the critic learns
                passes = min(passes, float(epoch))
            learning = passes == config.epochs
            scalars = found if learning or not scalars else scalars
            optimizer.zero_grad()
            (policy_loss + value_loss if learning else value_loss).backward()
            nn.utils.clip_grad_norm_(model.parameters(), config.max_grad_norm)  # 11
            optimizer.step()
    return {**scalars, "epochs": passes}


def losses(model: ActorCritic, rollout: Rollout, rows: Tensor, config: PPOConfig) -> tuple[Tensor, Tensor, dict[str, float]]:
    """Weighted losses of policy and critic on a minibatch, and its scalars."""
    dist, value = model(rollout.obs[rows])
    log_ratio = dist.log_prob(rollout.action[rows]) - rollout.log_prob[rows]
    ratio, advantage = log_ratio.exp(), rollout.advantage[rows]
    advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)  # 7
    policy = -torch.min(ratio * advantage, ratio.clamp(1 - config.clip, 1 + config.clip) * advantage).mean()  # 8
    old_value, target = rollout.value[rows], rollout.target[rows]
    clipped = old_value + (value - old_value).clamp(-config.clip, config.clip)
    critic = 0.5 * torch.max((value - target) ** 2, (clipped - target) ** 2).mean()  # 9
    entropy = dist.entropy().mean()
    kl = (log_ratio.exp() - 1 - log_ratio).mean()  # 12
    scalars = {"policy": policy.item(), "critic": critic.item(), "entropy": entropy.item(), "kl": kl.item()}
    return policy - config.entropy_weight * entropy, config.value_weight * critic, scalars  # 10


def _mean(metrics: list[dict[str, float]]) -> dict[str, float]:
    """Mean of every scalar over the steps that logged it."""
    names = sorted({name for one in metrics for name in one})
    return {name: _mean_of([one[name] for one in metrics if name in one]) for name in names}


def _mean_of(values: list[Any]) -> float:
    return float(torch.stack(values).mean() if isinstance(values[0], Tensor) else np.mean(values))
