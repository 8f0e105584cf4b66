"""Hand finder: a small network with a plain encoder or the frozen one of MediaPipe's palm detector."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate, relu

from afford.extraction.hands.palm_encoder import PalmEncoder

HAND, SIDE, TOUCHED, SLEEVE = range(4)
"""channels of the logits: hand; right hand rather than left, where there is a hand; touched object; sleeve"""


PLAIN, PALM = "plain", "palm"
"""encoders: one that is trained with the finder, and the frozen one of MediaPipe's palm detector"""


@dataclass(frozen=True)
class HandFinderConfig:
    """Sizes of the hand finder."""

    height_px: int = 160
    """approximate height of the input; the aspect ratio of a picture is kept"""
    width_px: int = 288
    """approximate width of the input"""
    widths: tuple[int, ...] = (16, 32, 48, 64, 96)
    """channels of the decoder at strides 2, 4, 8, 16 and 32; the plain encoder has the same"""


LAST, COORDINATES = 24, 2
"""least channels of the last layer of the decoder; coordinates of a pixel, which enter its first layer"""


class HandFinder(nn.Module):
    """Encoder and decoder with global context: pictures (b, 3, h, w), RGB 0..1, of any size -> logits (b, 4, h, w)."""

    def __init__(self, config: HandFinderConfig, encoder: str = PLAIN) -> None:
        super().__init__()
        self.config, self.kind = config, encoder
        self.encoder = PalmEncoder() if encoder == PALM else PlainEncoder(config.widths)
        given = self.encoder.widths
        widths = config.widths[: len(given)]
        self.reduce = nn.ModuleList(reduction(a, b) for a, b in zip(given, widths, strict=True))
        self.whole = nn.Linear(widths[-1], widths[-1])
        outer = (*widths[-2:0:-1], max(widths[0], LAST))
        inputs = zip((widths[-1], *outer), widths[-2::-1], (COORDINATES, *(0 for _ in outer)), strict=False)
        self.up = nn.ModuleList(layer(sum(maps), after) for maps, after in zip(inputs, outer, strict=False))
        self.head = nn.Conv2d(outer[-1], 4, 1)

    def forward(self, pictures: Tensor) -> Tensor:
        """Compute logits at half the size, and resize them to that of the pictures."""
        seen = [reduce(one) for reduce, one in zip(self.reduce, self.encoder(pictures), strict=True)]
        x = seen[-1] + relu(self.whole(seen[-1].mean((2, 3))))[..., None, None]
        for n, (up, skip) in enumerate(zip(self.up, seen[-2::-1], strict=True)):
            x = up(torch.cat([resize(x, skip.shape), skip, *([] if n else [_coordinates(skip)])], 1))
        return resize(self.head(x), pictures.shape)


class PlainEncoder(nn.Module):
    """Residual encoder that is trained with the finder: feature maps at strides 2, 4, 8, ..."""

    def __init__(self, widths: tuple[int, ...]) -> None:
        super().__init__()
        self.widths = widths
        first, *rest = widths
        self.stem = nn.Sequential(layer(3, first, 2), layer(first, first))
        self.down = nn.ModuleList(nn.Sequential(layer(a, b, 2), _Residual(b)) for a, b in zip(widths, rest, strict=False))

    def forward(self, pictures: Tensor) -> tuple[Tensor, ...]:
        """Compute the feature maps, the largest first."""
        seen = [self.stem(pictures * 4 - 2)]
        for down in self.down:
            seen.append(down(seen[-1]))
        return tuple(seen)


class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.change = nn.Sequential(layer(width, width), nn.Conv2d(width, width, 3, padding=1, bias=False), nn.BatchNorm2d(width))

    def forward(self, x: Tensor) -> Tensor:
        return relu(x + self.change(x))


def _coordinates(pictures: Tensor) -> Tensor:
    """Coordinate channels (b, 2, h, w): x and y of every pixel, -1..1."""
    down, across = (torch.linspace(-1, 1, side, device=pictures.device) for side in pictures.shape[-2:])
    place = torch.stack([across.expand(len(down), -1), down[:, None].expand(-1, len(across))])
    return place.expand(len(pictures), -1, -1, -1)


def reduction(before: int, after: int) -> nn.Sequential:
    """Build a pointwise convolution between batch normalisations, with ReLU."""
    return nn.Sequential(nn.BatchNorm2d(before), nn.Conv2d(before, after, 1, bias=False), nn.BatchNorm2d(after), nn.ReLU())


def layer(before: int, after: int, stride: int = 1) -> nn.Sequential:
    """Build a convolution with batch normalisation and ReLU."""
    return nn.Sequential(nn.Conv2d(before, after, 3, stride, 1, bias=False), nn.BatchNorm2d(after), nn.ReLU())


def resize(x: Tensor, shape: torch.Size) -> Tensor:
    """Resize maps (b, c, h, w) to the height and width of a shape, bilinearly."""
    return interpolate(x, (shape[-2], shape[-1]), mode="bilinear", align_corners=False)
