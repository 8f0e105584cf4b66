"""What encoder, latent and decoder are built of."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from afford.rgbd.model.config import Sor3dConfig


def convolution(inside: int, outside: int, norm: str) -> nn.Sequential:
    """3 x 3 convolution and ReLU, with batch normalisation between where the config says so. Size stays."""
    between = [nn.BatchNorm2d(outside)] if norm == "batch" else []
    return nn.Sequential(nn.Conv2d(inside, outside, 3, padding=1), *between, nn.ReLU(inplace=True))


def chain(widths: Sequence[int], norm: str) -> nn.Sequential:
    """Convolutions from each width to the next."""
    return nn.Sequential(*(convolution(a, b, norm) for a, b in pairwise(widths)))


class Residual(nn.Module):
    """Pre-activation residual block (He et al. 2016): x + conv(relu(conv(relu(x))))."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.first, self.second = (nn.Conv2d(width, width, 3, padding=1) for _ in range(2))

    def forward(self, x: Tensor) -> Tensor:
        return x + self.second(self.first(x.relu()).relu())


class Action(nn.Module):
    """Three layers on the mean and the maximum over positions of what is remembered.

    At first that differs little between sequences (by 7 to 18 % of its size): without normalisation over the batch all layers
    are moved by what sequences have in common, and drive the memory into saturation, where nothing tells them apart any more.
    Videos and pictures have statistics of their own.
    """

    def __init__(self, width: int, config: Sor3dConfig) -> None:
        super().__init__()
        inside, self.here = (4 if config.here else 2) * width, config.here
        self.video, self.picture = (nn.BatchNorm1d(inside) if config.norm == "batch" else nn.Identity() for _ in range(2))
        self.layers = nn.Sequential(nn.Linear(inside, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU(),
                                    nn.Linear(width, config.actions))  # fmt: skip

    def forward(self, remembered: Tensor, seen: Tensor) -> Tensor:
        """Memory (n, c, h, w) after frames of features (n, t, c, h, w) -> logits (n, actions). n of 2 or more while it is trained
        with a norm.
        """
        told = [remembered, seen[:, -1]] if self.here else [remembered]
        pooled = torch.cat([value for one in told for value in (one.mean((-2, -1)), one.amax((-2, -1)))], 1)
        found: Tensor = self.layers((self.video if seen.shape[1] > 1 else self.picture)(pooled))
        return found


def xavier(model: nn.Module) -> None:
    """Xavier's uniform weights (Glorot and Bengio 2010) and biases of 0 for all that multiplies."""
    for module in model.modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
            nn.init.xavier_uniform_(module.weight)
            if module.bias is not None:
                nn.init.zeros_(module.bias)
