"""A VGG-style encoder: 11 convolutions and 3 poolings, the first 11 convolutions of VGG16 at the paper's width."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor, nn

from afford.rgbd.model.parts import chain

CONVOLUTIONS = (2, 2, 3, 4)
"""at full, half, quarter and eighth resolution"""


class Encoder(nn.Module):
    """(n, c, h, w) -> features before each pooling and after the last: sides h, h // 2, h // 4, h // 8 (300, 150, 75, 37)."""

    def __init__(self, channels: int, widths: Sequence[int], norm: str) -> None:
        super().__init__()
        befores = (channels, *widths[:-1])
        self.stages = nn.ModuleList(
            chain((before, *[width] * count), norm) for before, width, count in zip(befores, widths, CONVOLUTIONS, strict=True)
        )
        self.pool = nn.MaxPool2d(2)

    def forward(self, x: Tensor) -> list[Tensor]:
        found = []
        for n, stage in enumerate(self.stages):
            x = stage(self.pool(x) if n else x)
            found.append(x)
        return found
