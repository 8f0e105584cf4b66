"""Mean and variance of what streams by, for observations of any scale."""

from __future__ import annotations

import torch
from torch import Tensor, nn


class Running(nn.Module):
    """Normalises (n, d) to zero mean and unit variance of all that `update` ever saw (Chan et al. 1979), within `clip`."""

    mean: Tensor
    var: Tensor
    count: Tensor

    def __init__(self, width: int, clip: float = 5.0) -> None:
        super().__init__()
        self.clip = clip
        self.register_buffer("mean", torch.zeros(width, dtype=torch.float64))
        self.register_buffer("var", torch.ones(width, dtype=torch.float64))
        self.register_buffer("count", torch.zeros((), dtype=torch.float64))

    def update(self, x: Tensor) -> None:
        """Take a batch (n, d) in."""
        x = x.detach().double()
        n, total = len(x), self.count + len(x)
        delta = x.mean(0) - self.mean
        squares = self.var * self.count + x.var(0, unbiased=False) * n + delta**2 * self.count * n / total
        self.mean += delta * n / total
        self.var.copy_(squares / total)
        self.count.copy_(total)

    def forward(self, x: Tensor) -> Tensor:
        """(n, d) float32."""
        return ((x - self.mean) / (self.var + 1e-8).sqrt()).float().clamp(-self.clip, self.clip)
