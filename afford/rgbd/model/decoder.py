"""From the latent of the last frame to the class of every pixel: 14 convolutions, three upsamplings, skip connections."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from afford.rgbd.model.attention import enlarged
from afford.rgbd.model.parts import chain, convolution

LATENT = 4
"""convolutions before the first upsampling"""
AFTER = (3, 2, 2)
"""convolutions after each upsampling, beside its own"""


class Rise(nn.Module):
    """One upsampling: nearest to the size of the skip connection, a convolution, attention, the skip mixed in, convolutions."""

    def __init__(self, below: int, width: int, skips: int, count: int, norm: str) -> None:
        """`skips` channels of skip connections, of all streams together."""
        super().__init__()
        self.up = convolution(below, width, norm)
        self.mix = nn.Conv2d(width + skips, width, 1)
        self.then = chain([width] * (count + 1), norm)

    def forward(self, x: Tensor, skips: Sequence[Tensor], attention: Tensor | None) -> Tensor:
        size = (skips[0].shape[-2], skips[0].shape[-1])
        x = self.up(interpolate(x, size, mode="nearest"))
        if attention is not None:
            x = x * enlarged(attention, size)
        found: Tensor = self.then(self.mix(torch.cat([x, *skips], 1)))
        return found


class Decoder(nn.Module):
    """`streams` encoders give skip connections. Attention, where there is one, multiplies the latent and every upsampling."""

    def __init__(self, encoded: Sequence[int], widths: Sequence[int], streams: int, labels: int, norm: str) -> None:
        """`encoded` and `widths`: channels of the encoders and of the decoder at full, half, quarter and eighth resolution."""
        super().__init__()
        self.latent = chain([encoded[-1], *[widths[-1]] * LATENT], norm)
        rising = zip(reversed(widths), reversed(widths[:-1]), reversed(encoded[:-1]), AFTER, strict=False)
        self.rises = nn.ModuleList(Rise(below, width, streams * skip, count, norm) for below, width, skip, count in rising)
        self.classes = nn.Conv2d(widths[0], labels, 1)

    def forward(self, latent: Tensor, skips: Sequence[Sequence[Tensor]], attention: Tensor | None) -> Tensor:
        """Latent (n, c, h, w) and, from full to quarter resolution, the features of each stream -> logits (n, labels, H, W)."""
        x = self.latent(latent if attention is None else latent * attention)
        for rise, skip in zip(self.rises, reversed(skips), strict=True):
            x = rise(x, skip, attention)
        found: Tensor = self.classes(x)
        return found
