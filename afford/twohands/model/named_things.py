"""Places where a classifier of photographs sees the things that a task names.

A classifier that averages over the picture at its end scores every class at every place (class activation maps, Zhou et al. 2016).
ImageNet has a thousand kinds of things, so a kind that no affordance was learned for is found, too.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Size, Tensor, cat, nn
from torch.nn.functional import interpolate

from afford.twohands.model.class_words import THINGS

Named = Sequence[tuple[tuple[int, ...], ...]]
"""positions in `class_words.SHOWN` of the classes of each thing of b tasks"""
PER_THING = 3
"""planes of a thing: score, logarithm of the probability, and one for a thing that has classes"""
SCALE = 0.1
"""on scores, which go up to about 20"""
UNSURE = 0.03
"""probability of a thing below which a classifier does not know"""
TRUST = 1.5
"""weight of what the classifier sees in a prediction; 1 in training, on rendered pictures, which it knows less than photographs"""


class NamedThings(nn.Module):
    """Features of the places where the things of a task are seen."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.read = nn.Sequential(nn.Conv2d(1 + THINGS * PER_THING, width, 1), nn.ReLU(), nn.Conv2d(width, width, 1))

    def forward(self, scores: Tensor, named: Named, size: Size) -> Tensor:
        """Logits (b, h, w, len(SHOWN)) and the things of each task -> features (b, width, *size)."""
        return self.read(interpolate(evidence(scores, named), size, mode="bilinear", align_corners=False))


def evidence(scores: Tensor, named: Named) -> Tensor:
    """Planes (b, 1 + THINGS * PER_THING, h, w): the best score of all classes, then those of each thing; 0 without a thing."""
    best, whole = scores.amax(-1, keepdim=True), scores.logsumexp(-1, keepdim=True)
    rows = []
    for one, classes in enumerate(named):
        planes = [SCALE * best[one]]
        for ids in classes:
            mine = scores[one, ..., list(ids)]
            planes += [SCALE * mine.amax(-1, keepdim=True), SCALE * (mine.logsumexp(-1, keepdim=True) - whole[one]),
                       torch.ones_like(whole[one])]  # fmt: skip
        planes += [torch.zeros_like(whole[one])] * (1 + THINGS * PER_THING - len(planes))
        rows.append(cat(planes, dim=-1))
    return torch.stack(rows).permute(0, 3, 1, 2)


def named_logits(scores: Tensor, named: Named, trust: float = 1.0) -> Tensor:
    """Logits (b, 1, h, w) to add to regions: 0 where no thing of a task is seen, 3.5 x `trust` where one surely is."""
    probability = scores.softmax(-1)
    rows = []
    for one, things in enumerate(named):
        seen = [probability[one, ..., list(ids)].sum(-1) for ids in things]
        rows.append(torch.stack(seen).amax(0) if seen else torch.zeros_like(probability[one, ..., 0]))
    return trust * ((torch.stack(rows) + UNSURE) / UNSURE).log()[:, None]
