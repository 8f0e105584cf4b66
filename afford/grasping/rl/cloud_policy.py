"""Point-cloud policy: PointNets with the robot's own numbers, a transformer over their tokens, attention pooling, an MLP."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn

from afford.grasping.rl.ppo import RunningMeanStd, mlp

UNIT_M = 0.1
"""points in metres are divided by it: about the size of a hand"""


@dataclass(frozen=True)
class CloudConfig:
    """Sizes of a point-cloud policy. The fields are keys of student.json."""

    robot: int
    """width of the robot's own numbers"""
    action: int
    """width of an action"""
    points: tuple[int, ...] = (32, 64)
    """widths of the layers that are applied to each point"""
    width: int = 64
    """width of a token"""
    blocks: int = 1
    """blocks of the transformer"""
    heads: int = 4
    """attention heads of the transformer"""
    dropout: float = 0.0
    """dropout of the transformer"""
    hidden: tuple[int, ...] = (128, 128)
    """widths of the MLP's hidden layers"""
    activation: str = "elu"
    """activation of the MLP: tanh or elu"""


def paper_config(robot: int, action: int) -> CloudConfig:
    """Return the sizes of AffordDex."""
    return CloudConfig(robot, action, (128, 256), 128, 2, 4, 0.1, (1024, 1024, 512, 512))


class PointNet(nn.Module):
    """PointNet from points of one kind to a token: per-point layers, pooled by their maximum and their mean."""

    def __init__(self, channels: int, robot: int, config: CloudConfig) -> None:
        super().__init__()
        first, last = config.points[0], config.points[-1]
        self.point, self.state = nn.Linear(channels, first), nn.Linear(robot, first, bias=False)
        layers = [layer for a, b in pairwise(config.points) for layer in (nn.Linear(a, b), nn.ReLU(inplace=True))]
        self.each = nn.Sequential(nn.ReLU(inplace=True), *layers)
        self.pooled = nn.Sequential(nn.Linear(last, last), nn.ReLU(), nn.Linear(last, config.width))

    def forward(self, points: Tensor, robot: Tensor) -> Tensor:
        """(n, k, c), (n, r) -> (n, width). A layer over points and robot numbers together equals the sum of a layer over each."""
        each = self.each(self.point(points) + self.state(robot)[:, None])
        token: Tensor = self.pooled(each.max(dim=1).values + each.mean(dim=1))
        return token


class CloudPolicy(nn.Module):
    """Student policy that DAgger trains, from point clouds of hand and object, negative points and the robot's own numbers."""

    def __init__(self, config: CloudConfig) -> None:
        super().__init__()
        self.config = config
        self.seen = RunningMeanStd(config.robot)  # the attribute names are keys of student.safetensors
        self.hand, self.object, self.negative = (PointNet(3, config.robot, config) for _ in range(3))
        self.all = PointNet(4, config.robot, config)
        layer = nn.TransformerEncoderLayer(config.width, config.heads, 2 * config.width, config.dropout, batch_first=True)
        self.mixer = nn.TransformerEncoder(layer, config.blocks, enable_nested_tensor=False)
        self.weight = nn.Linear(config.width, 1)
        self.actor = mlp((config.width + config.robot, *config.hidden, config.action), config.activation, last=0.01)

    @property
    def device(self) -> torch.device:
        """Device of the parameters."""
        return self.weight.weight.device

    def forward(self, robot: Tensor, cloud: Tensor, N: Tensor) -> Tensor:
        """(n, r), (n, k, 3) whose first half is the hand, (n, p, 3) negative points -> (n, action)."""
        state = self.seen(robot)
        whole, negative = cloud.float() / UNIT_M, N.float() / UNIT_M
        hand, obj = whole.chunk(2, dim=1)
        kind = torch.linspace(0, 1, 2, device=whole.device).repeat_interleave(hand.shape[1])
        kind = kind[None, :, None].expand(len(whole), -1, 1)
        tokens = torch.stack([self.hand(hand, state), self.object(obj, state), self.all(torch.cat([whole, kind], 2), state),
                              self.negative(negative, state)], dim=1)  # fmt: skip
        mixed = self.mixer(tokens)
        pooled = (self.weight(mixed).softmax(dim=1) * mixed).sum(dim=1)
        action: Tensor = self.actor(torch.cat([pooled, state], dim=1))
        return action

    def loss(self, obs: list[Tensor], label: Tensor) -> tuple[Tensor, Tensor]:
        """Loss and squared error of actions, which are the same here, for labels (n, action)."""
        error = nn.functional.mse_loss(self(*obs), label)
        return error, error
