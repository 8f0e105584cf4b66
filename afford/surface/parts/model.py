"""The dual encoder: convolutions over what is seen, hashed pieces of words over what is asked, and how well they fit."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from afford.models.word_vectors import WordVectors
from afford.surface.parts.crops import CHANNELS
from afford.surface.parts.form import FORM

TRAITS = 4 + len(FORM)
"""numbers that come with a candidate (see traits.py and form.py)"""


@dataclass(frozen=True)
class PartsConfig:
    """Sizes."""

    widths: tuple[int, ...] = (24, 48, 96, 128)
    """channels after each halving of the picture"""
    width: int = 128
    """of the space in which both sides meet"""
    text_buckets: int = 2048
    """rows of the table that pieces of words are hashed into"""
    text_words: int = 16
    """words read of a phrase"""


class Parts(nn.Module):
    """Candidates and phrases -> for each pair, two logits: which share of the mask shows the part, and how well mask and part
    overlap (IoU).
    """

    def __init__(self, config: PartsConfig) -> None:
        super().__init__()
        self.config = config
        self.close, self.whole = _trunk(config.widths), _trunk(config.widths)
        self.image = nn.Sequential(nn.Linear(2 * config.widths[-1] + TRAITS, 2 * config.width), nn.ReLU(), nn.Dropout(0.2),
                                   nn.Linear(2 * config.width, 2 * config.width))  # fmt: skip
        self.words = WordVectors(config.text_buckets, config.text_words, config.width)
        self.text = nn.Sequential(nn.LayerNorm(config.width), nn.Linear(config.width, config.width), nn.ReLU(),
                                  nn.Linear(config.width, 2 * config.width))  # fmt: skip
        self.scale, self.bias = nn.Parameter(torch.full((2,), 2.0)), nn.Parameter(torch.full((2,), -1.0))

    def forward(self, crops: Tensor, traits: Tensor, phrases: tuple[str, ...]) -> Tensor:
        """(b, 2, 6, s, s) 0..1 and (b, TRAITS) of candidates, k phrases -> (b, k, 2) logits."""
        return self.fit(self.seen(crops, traits), self.said(phrases))

    def seen(self, crops: Tensor, traits: Tensor) -> Tensor:
        """(b, 2, width) of candidates."""
        found = [trunk(crops[:, k] - 0.5).mean((2, 3)) for k, trunk in enumerate((self.close, self.whole))]
        return _unit(self.image(torch.cat([*found, traits], -1)))

    def said(self, phrases: tuple[str, ...]) -> Tensor:
        """(k, 2, width) of phrases: the mean over their words."""
        vectors, real = self.words(phrases)
        mean = (vectors * real[..., None]).sum(1) / real.sum(1, keepdim=True)
        return _unit(self.text(mean))

    def fit(self, seen: Tensor, said: Tensor) -> Tensor:
        """(b, k, 2) logits of every pair: scaled cosines, so that nothing may fit (Zhai et al. 2023, sigmoid loss)."""
        return torch.einsum("bhw,khw->bkh", seen, said) * self.scale.exp() + self.bias


def _unit(both: Tensor) -> Tensor:
    return nn.functional.normalize(both.unflatten(-1, (2, -1)), dim=-1)


def _trunk(widths: tuple[int, ...]) -> nn.Sequential:
    layers: list[nn.Module] = []
    for before, after in zip((len(CHANNELS), *widths), widths, strict=False):
        layers += [nn.Conv2d(before, after, 3, stride=2, padding=1), nn.BatchNorm2d(after), nn.ReLU()]
        layers += [nn.Conv2d(after, after, 3, padding=1, groups=after), nn.Conv2d(after, after, 1)]
        layers += [nn.BatchNorm2d(after), nn.ReLU()]
    return nn.Sequential(*layers)
