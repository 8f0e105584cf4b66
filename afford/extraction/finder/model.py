"""A small fully convolutional network with skips: a picture in; hand, side, touched thing and sleeve of every
pixel out.

Normalised over the batch after every convolution (docs/decisions/017): pictures of rooms have much in common, and a norm within a
picture would keep what is common. Every pixel knows its place in the picture, because left hands are mostly at the left, and arms
come from the near edge. What the coarsest features say of the whole picture is told to all of its places: the colour of
the light, and how many hands there are.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, relu

HAND, SIDE, TOUCHED, SLEEVE = range(4)
"""planes of the logits: a hand or not; the right hand rather than the left one, where there is a hand; a thing that is touched;
cloth on an arm"""


@dataclass(frozen=True)
class HandsConfig:
    """Sizes."""

    height_px: int = 144
    """height to which a picture is brought, about: its aspect stays"""
    width_px: int = 256
    """width of that"""
    widths: tuple[int, ...] = (16, 24, 48, 80, 128)
    """channels after each halving of the picture"""


class Hands(nn.Module):
    """Pictures (b, 3, h, w), RGB 0..1, of any size -> logits (b, 4, h, w)."""

    def __init__(self, config: HandsConfig) -> None:
        super().__init__()
        self.config = config
        first, *rest = config.widths
        self.stem = nn.Sequential(_layer(5, first, 2), _layer(first, first))
        self.down = nn.ModuleList(nn.Sequential(_layer(a, b, 2), _Residual(b)) for a, b in zip(config.widths, rest, strict=False))
        self.whole = nn.Linear(config.widths[-1], config.widths[-1])
        self.up = nn.ModuleList(_layer(a + b, b) for a, b in zip(rest[::-1], config.widths[-2::-1], strict=True))
        self.head = nn.Conv2d(first, 4, 1)

    def forward(self, pictures: Tensor) -> Tensor:
        """The last features are at half the size; their logits are brought to that of the pictures."""
        seen = [self.stem(torch.cat([pictures * 4 - 2, _places(pictures)], 1))]
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


def _places(pictures: Tensor) -> Tensor:
    """(b, 2, h, w): how far every pixel is to the right and down, -1..1."""
    down, across = (torch.linspace(-1, 1, side, device=pictures.device) for side in pictures.shape[-2:])
    place = torch.stack([across.expand(len(down), -1), down[:, None].expand(-1, len(across))])
    return place.expand(len(pictures), -1, -1, -1)


def _layer(before: int, after: int, stride: int = 1) -> nn.Sequential:
    """A convolution, its norm and what makes it bend."""
    return nn.Sequential(nn.Conv2d(before, after, 3, stride, 1, bias=False), nn.BatchNorm2d(after), nn.ReLU())


def _resized(x: Tensor, shape: torch.Size) -> Tensor:
    return interpolate(x, (shape[-2], shape[-1]), mode="bilinear", align_corners=False)
