"""A small fully convolutional network with skips: a picture in; hand, side and touched thing of every pixel out.

Normalised over the batch after every convolution (docs/decisions/017): pictures of rooms have much in common, and a norm within a
picture would keep what is common. What the coarsest features say of the whole picture is told to all of its places: the colour of
the light, and how many hands there are.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, relu

HAND, SIDE, TOUCHED = range(3)
"""planes of the logits: a hand or not; the right hand rather than the left one, where there is a hand; a thing that is touched"""


@dataclass(frozen=True)
class HandsConfig:
    """Sizes."""

    height_px: int = 160
    """height of the pictures that it learned from, and that a picture is brought to"""
    width_px: int = 288
    """width of those"""
    widths: tuple[int, ...] = (16, 32, 64, 96, 128)
    """channels after each halving of the picture"""


class Hands(nn.Module):
    """Pictures (b, 3, h, w), RGB 0..1, of any size -> logits (b, 3, h, w)."""

    def __init__(self, config: HandsConfig) -> None:
        super().__init__()
        self.config = config
        first, *rest = config.widths
        self.stem = nn.Sequential(_layer(3, first, 2), _layer(first, first))
        self.down = nn.ModuleList(nn.Sequential(_layer(a, b, 2), _Residual(b)) for a, b in zip(config.widths, rest, strict=False))
        self.whole = nn.Linear(config.widths[-1], config.widths[-1])
        self.up = nn.ModuleList(_layer(a + b, b) for a, b in zip(rest[::-1], config.widths[-2::-1], strict=True))
        self.head = nn.Conv2d(first, 3, 1)

    def forward(self, pictures: Tensor) -> Tensor:
        """The last features are at half the size; their logits are brought to that of the pictures."""
        seen = [self.stem(pictures * 4 - 2)]
        for down in self.down:
            seen.append(down(seen[-1]))
        x = seen[-1] + relu(self.whole(seen[-1].mean((2, 3))))[..., None, None]
        for up, skip in zip(self.up, seen[-2::-1], strict=True):
            x = up(torch.cat([_resized(x, skip.shape), skip], 1))
        return _resized(self.head(x), pictures.shape)


class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.change = nn.Sequential(_layer(width, width), nn.Conv2d(width, width, 3, padding=1, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: Tensor) -> Tensor:
        return relu(x + self.change(x))


def _layer(before: int, after: int, stride: int = 1) -> nn.Sequential:
    """A convolution, its norm and what makes it bend."""
    return nn.Sequential(nn.Conv2d(before, after, 3, stride, 1, bias=False), nn.BatchNorm2d(after), nn.ReLU())


def _resized(x: Tensor, shape: torch.Size) -> Tensor:
    return interpolate(x, (shape[-2], shape[-1]), mode="bilinear", align_corners=False)
