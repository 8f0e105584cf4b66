"""Soft attention over positions."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate


class Attention(nn.Module):
    """A 1 x 1 convolution of what is seen beside what is remembered, softmax over positions."""

    def __init__(self, width: int, rescale: bool) -> None:
        super().__init__()
        self.score, self.rescale = nn.Conv2d(2 * width, 1, 1), rescale

    def forward(self, seen: Tensor, remembered: Tensor) -> Tensor:
        """(n, c, h, w) twice -> (n, 1, h, w), summing to 1; times h * w, a mean of 1, when it is rescaled."""
        score = self.score(torch.cat([seen, remembered], 1))
        share = score.flatten(1).softmax(-1).view_as(score)
        return share * score[0].numel() if self.rescale else share


def enlarged(attention: Tensor, size: tuple[int, int]) -> Tensor:
    """The same attention over more positions, by the nearest one."""
    return interpolate(attention, size, mode="nearest")
