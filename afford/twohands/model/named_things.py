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


class NamedThings(nn.Module):
    """Features of the places where the things of a task are seen."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.read = nn.Sequential(nn.Conv2d(1 + THINGS * PER_THING, width, 1), nn.ReLU(), nn.Conv2d(width, width, 1))

    def forward(self, scores: Tensor, named: Tensor, size: Size) -> Tensor:
        """Logits (b, h, w, n) and the classes of the things (b, THINGS, n) of each task -> features (b, width, *size)."""
        return self.read(interpolate(evidence(scores, named), size, mode="bilinear", align_corners=False))


def membership(named: Named, count: int, device: torch.device) -> Tensor:
    """(b, THINGS, count) bool: which of `count` classes show each thing; none for a thing that is missing."""
    out = torch.zeros(len(named), THINGS, count, dtype=torch.bool)
    for row, things in zip(out, named, strict=True):
        for plane, ids in zip(row, things, strict=False):
            plane[list(ids)] = True
    return out.to(device)


def evidence(scores: Tensor, named: Tensor) -> Tensor:
    """Planes (b, 1 + THINGS * PER_THING, h, w): the best score of all classes, then those of each thing; 0 without a thing."""
    there = named.any(-1)[..., None, None]
    highest = scores[:, None].masked_fill(~named[:, :, None, None], -torch.inf).amax(-1)
    planes = torch.stack([highest, log_probability(scores, named), torch.ones_like(highest)], dim=2)
    of_things = (planes * planes.new_tensor((SCALE, SCALE, 1.0))[:, None, None]).masked_fill(~there[:, :, None], 0)
    return cat([SCALE * scores.amax(-1)[:, None], of_things.flatten(1, 2)], dim=1)


def log_probability(scores: Tensor, named: Tensor) -> Tensor:
    """Logarithm of the probability (b, THINGS, h, w) of each thing at every place, from logits (b, h, w, n); -inf without one."""
    return scores.log_softmax(-1)[:, None].masked_fill(~named[:, :, None, None], -torch.inf).logsumexp(-1)


def named_logits(scores: Tensor, named: Tensor) -> Tensor:
    """Logits (b, 1, h, w) to add to regions: 0 where no thing of a task is seen, 3.5 where one surely is."""
    return ((log_probability(scores, named).amax(1, keepdim=True).exp() + UNSURE) / UNSURE).log()
