"""Actor and critic: two perceptrons over normalised observations, and a Gaussian whose spread does not depend on them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.distributions import Independent, Normal

from afford.grasping.rl.running import Running

ACTIVATIONS = {"tanh": nn.Tanh, "elu": nn.ELU}


@dataclass(frozen=True)
class PolicyConfig:
    """Sizes."""

    observation: int
    """numbers in"""
    action: int
    """numbers out"""
    hidden: tuple[int, ...] = (128, 128)
    """widths of the layers between, of both networks"""
    activation: str = "tanh"
    """tanh or elu"""
    std: float = 0.5
    """spread of the actions in the beginning"""


def paper(observation: int, action: int) -> PolicyConfig:
    """As AffordDex has it."""
    return PolicyConfig(observation, action, (1024, 1024, 512, 512), "elu", 0.8)


class ActorCritic(nn.Module):
    """What PPO trains."""

    def __init__(self, config: PolicyConfig) -> None:
        super().__init__()
        self.config = config
        self.seen = Running(config.observation)
        self.actor = perceptron((config.observation, *config.hidden, config.action), config.activation, last=0.01)
        self.critic = perceptron((config.observation, *config.hidden, 1), config.activation, last=1.0)
        self.log_std = nn.Parameter(torch.full((config.action,), config.std).log())

    def forward(self, observation: Tensor) -> tuple[Independent, Tensor]:
        """(n, d) -> distribution of actions (n, a), values (n,)."""
        return self.actions(observation), self.value(observation)

    def actions(self, observation: Tensor) -> Independent:
        """Distribution of actions (n, a); its mean is what a trained policy does."""
        mean = self.actor(self.seen(observation))
        return Independent(Normal(mean, self.log_std.exp().expand_as(mean)), 1)

    def value(self, observation: Tensor) -> Tensor:
        """(n,) what is still to come."""
        return self.critic(self.seen(observation))[..., 0]


def perceptron(widths: tuple[int, ...], activation: str, last: float) -> nn.Sequential:
    """Linear layers with orthogonal weights, the last one scaled by `last`: small first actions (Andrychowicz et al. 2021)."""
    layers: list[nn.Module] = []
    for n, (before, after) in enumerate(pairwise(widths)):
        linear = nn.Linear(before, after)
        final = n == len(widths) - 2
        nn.init.orthogonal_(linear.weight, last if final else 2**0.5)
        nn.init.zeros_(linear.bias)
        layers += [linear] if final else [linear, ACTIVATIONS[activation]()]
    return nn.Sequential(*layers)
