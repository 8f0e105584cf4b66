"""Attention and what goes with it; every part builds on these and on no other part."""

from __future__ import annotations

import itertools

import torch
from torch import Tensor, nn
from torch.nn.functional import scaled_dot_product_attention


class Attention(nn.Module):
    """Multi-head attention of queries over keys."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.query, self.key, self.value = (nn.Linear(width, width) for _ in range(3))
        self.out = nn.Linear(width, width)

    def forward(self, query: Tensor, key: Tensor, value: Tensor, keep: Tensor | None = None) -> Tensor:
        """query (b, n, c), key and value (b, m, c), keep (b, m) bool: which keys may be looked at. Returns (b, n, c)."""
        q, k, v = self._split(self.query(query)), self._split(self.key(key)), self._split(self.value(value))
        mask = None if keep is None else keep[:, None, None, :]
        return self.out(scaled_dot_product_attention(q, k, v, attn_mask=mask).transpose(1, 2).flatten(2))

    def _split(self, x: Tensor) -> Tensor:
        return x.unflatten(-1, (self.heads, -1)).transpose(1, 2)  # (b, heads, n, c / heads)


class Block(nn.Module):
    """Pre-norm transformer block: self-attention, then a two-layer perceptron of `ratio` times the width."""

    def __init__(self, width: int, heads: int, ratio: int = 4, dropout: float = 0.0) -> None:
        super().__init__()
        self.norm1, self.norm2 = nn.LayerNorm(width), nn.LayerNorm(width)
        self.attention, self.mlp = Attention(width, heads), mlp(width, ratio * width, width)
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor, keep: Tensor | None = None) -> Tensor:
        """(b, n, c) -> (b, n, c); `keep` (b, n) bool says which tokens are real."""
        y = self.norm1(x)
        x = x + self.dropout(self.attention(y, y, y, keep))
        return x + self.dropout(self.mlp(self.norm2(x)))


def mlp(*widths: int) -> nn.Sequential:
    """Linear layers of these widths with GELU between them."""
    layers: list[nn.Module] = []
    for before, after in itertools.pairwise(widths):
        layers += [nn.Linear(before, after), nn.GELU()]
    return nn.Sequential(*layers[:-1])


def sines(height: int, width: int, channels: int, step: float = 1.0) -> Tensor:
    """(height * width, channels) fixed positions: sines and cosines of y and x, `step` apart, at geometric wavelengths."""
    frequency = 1000.0 ** (-torch.arange(channels // 4) / (channels // 4))
    y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    angles = [step * axis.flatten()[:, None] * frequency for axis in (y, x)]
    return torch.cat([wave(angle) for angle in angles for wave in (torch.sin, torch.cos)], dim=1)
