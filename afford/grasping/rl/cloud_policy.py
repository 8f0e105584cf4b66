"""A policy that sees clouds: a PointNet for each kind of points, the robot's numbers beside every point; a transformer over what
they say; attention pooling; a perceptron.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn

from afford.grasping.rl.policy import perceptron
from afford.grasping.rl.running import Running

UNIT_M = 0.1
"""points come in metres; hands are about so large"""


@dataclass(frozen=True)
class CloudConfig:
    """Sizes."""

    robot: int
    """numbers of the robot"""
    action: int
    """numbers out"""
    points: tuple[int, ...] = (32, 64)
    """widths of what is computed for each point"""
    width: int = 64
    """of a token"""
    blocks: int = 1
    """of the transformer"""
    heads: int = 4
    """of its attention"""
    dropout: float = 0.0
    """of the transformer"""
    hidden: tuple[int, ...] = (128, 128)
    """widths of the perceptron"""
    activation: str = "elu"
    """of the perceptron: tanh or elu"""


def paper(robot: int, action: int) -> CloudConfig:
    """As AffordDex has it."""
    return CloudConfig(robot, action, (128, 256), 128, 2, 4, 0.1, (1024, 1024, 512, 512))


class PointNet(nn.Module):
    """Points of one kind -> a token. What is computed for each point is pooled by its maximum and its mean."""

    def __init__(self, channels: int, robot: int, config: CloudConfig) -> None:
        super().__init__()
        first, last = config.points[0], config.points[-1]
        self.point, self.state = nn.Linear(channels, first), nn.Linear(robot, first, bias=False)
        layers = [layer for a, b in pairwise(config.points) for layer in (nn.Linear(a, b), nn.ReLU(inplace=True))]
        self.each = nn.Sequential(nn.ReLU(inplace=True), *layers)
        self.pooled = nn.Sequential(nn.Linear(last, last), nn.ReLU(), nn.Linear(last, config.width))

    def forward(self, points: Tensor, robot: Tensor) -> Tensor:
        """(n, k, c), (n, r) -> (n, width). One layer over points and numbers together is the sum of a layer over each."""
        each = self.each(self.point(points) + self.state(robot)[:, None])
        token: Tensor = self.pooled(each.max(dim=1).values + each.mean(dim=1))
        return token


class CloudPolicy(nn.Module):
    """What DAgger trains."""

    def __init__(self, config: CloudConfig) -> None:
        super().__init__()
        self.config = config
        self.seen = Running(config.robot)
        self.hand, self.object, self.negative = (PointNet(3, config.robot, config) for _ in range(3))
        self.all = PointNet(4, config.robot, config)
        layer = nn.TransformerEncoderLayer(config.width, config.heads, 2 * config.width, config.dropout, batch_first=True)
        self.mixer = nn.TransformerEncoder(layer, config.blocks, enable_nested_tensor=False)
        self.weight = nn.Linear(config.width, 1)
        self.actor = perceptron((config.width + config.robot, *config.hidden, config.action), config.activation, last=0.01)

    def forward(self, robot: Tensor, cloud: Tensor, N: Tensor) -> Tensor:
        """(n, r), (n, k, 3) of which half is the hand's, (n, p, 3) -> (n, action)."""
        state = self.seen(robot)
        whole, negative = cloud.float() / UNIT_M, N.float() / UNIT_M
        hand, thing = whole.chunk(2, dim=1)
        kind = torch.linspace(0, 1, 2).repeat_interleave(hand.shape[1])[None, :, None].expand(len(whole), -1, 1)
        tokens = torch.stack([self.hand(hand, state), self.object(thing, state), self.all(torch.cat([whole, kind], 2), state),
                              self.negative(negative, state)], dim=1)  # fmt: skip
        mixed = self.mixer(tokens)
        pooled = (self.weight(mixed).softmax(dim=1) * mixed).sum(dim=1)
        action: Tensor = self.actor(torch.cat([pooled, state], dim=1))
        return action
