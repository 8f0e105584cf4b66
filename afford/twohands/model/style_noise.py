"""Noise on the style of features in training, so that a model relies less on the look of the pictures that it learns from.

Mean and scale of a channel over a picture follow its light, its colours and its renderer more than what it shows. They are
drawn around their values for half of the samples (after Li et al. 2022, DSU, which draws them as widely as they vary in a batch).
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

SHARE = 0.5
"""share of samples with noise"""


def with_style_noise(features: Sequence[Tensor], strength: float, seed: int) -> list[Tensor]:
    """Noise on mean and scale of every channel of features (b, c, h, w) of the same b samples, as a function of the seed.

    strength: standard deviation of the noise, for the scale as a share of itself, for the mean in deviations of its channel.
    """
    generator = torch.Generator().manual_seed(seed)
    chosen = torch.rand(len(features[0]), 1, 1, 1, generator=generator) < SHARE
    noisy = []
    for x in features:
        shape = (2, *x.shape[:2], 1, 1)
        scale, shift = (strength * chosen * torch.randn(shape, generator=generator)).to(x.device, x.dtype)
        mean, deviation = x.mean((2, 3), keepdim=True), x.std((2, 3), keepdim=True, correction=0)
        noisy.append(x + scale * (x - mean) + shift * deviation)
    return noisy
