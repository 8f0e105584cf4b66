"""What encoder, latent and decoder are built of."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

GROUP = 8
"""channels of a group of group normalisation, where they divide evenly"""


def convolution(inside: int, outside: int, norm: str) -> nn.Sequential:
    """3 x 3 convolution and ReLU, with group normalisation between where the config says so. Size stays."""
    conv = nn.Conv2d(inside, outside, 3, padding=1)
    between = [nn.GroupNorm(max(outside // GROUP, 1) if outside % GROUP == 0 else 1, outside)] if norm == "group" else []
    return nn.Sequential(conv, *between, nn.ReLU())


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

    def __init__(self, width: int, actions: int, norm: str) -> None:
        super().__init__()
        self.video, self.picture = (nn.BatchNorm1d(2 * width) if norm == "group" else nn.Identity() for _ in range(2))
        self.layers = nn.Sequential(nn.Linear(2 * width, width), nn.ReLU(), nn.Linear(width, width), nn.ReLU(),
                                    nn.Linear(width, actions))  # fmt: skip

    def forward(self, remembered: Tensor, steps: int) -> Tensor:
        """(n, c, h, w) after so many frames -> logits (n, actions). n of 2 or more while it is trained with a norm."""
        pooled = torch.cat([remembered.mean((-2, -1)), remembered.amax((-2, -1))], 1)
        found: Tensor = self.layers((self.video if steps > 1 else self.picture)(pooled))
        return found


def xavier(model: nn.Module) -> None:
    """Xavier's uniform weights (Glorot and Bengio 2010) and biases of 0 for all that multiplies."""
    for module in model.modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
            nn.init.xavier_uniform_(module.weight)
            if module.bias is not None:
                nn.init.zeros_(module.bias)
