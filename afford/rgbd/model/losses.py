"""What is learned: the classes of the pixels of the last frame, and the action."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy, one_hot

from afford.rgbd.model.model import Said
from schemas.interaction import BACKGROUND


@dataclass(frozen=True)
class LossParams:
    """total = l1 * mean over pixels of -log p + l2 * cross-entropy of the action (SOR3D-AFF)."""

    early: tuple[float, float] = (0.2, 0.8)
    """l1, l2 until `turn`"""
    late: tuple[float, float] = (0.5, 0.5)
    """l1, l2 from then on"""
    turn: float = 0.75
    """share of the steps (150 of 200 epochs in the paper)"""
    dice: float = 0.0
    """weight of the Dice loss of the affordances beside l1's mean (Milletari et al. 2016); 0 in the paper"""
    foreground: float = 1.0
    """weight of pixels that are not background; 1 in the paper. The mean is a weighted one"""

    def weights(self, done: float) -> tuple[float, float]:
        """l1, l2 when a share `done` of the steps is done."""
        return self.early if done < self.turn else self.late


def losses(said: Said, label: Tensor, action: Tensor, params: LossParams, done: float) -> dict[str, Tensor]:
    """`label` (n, h, w) int64 of the last frame, `action` (n,) int64. Nothing else of a sequence has a label."""
    classes = torch.full((said.logits.shape[1],), params.foreground, device=said.logits.device)
    classes[BACKGROUND] = 1.0
    pixels = of_pixels(said.logits.float(), label, classes)
    told = cross_entropy(said.action.float(), action)
    overlap = missed(said.logits.float(), label)
    first, second = params.weights(done)
    total = first * (pixels + params.dice * overlap) + second * told
    return {"total": total, "pixels": pixels, "dice": overlap, "action": told}


def of_pixels(logits: Tensor, label: Tensor, weight: Tensor) -> Tensor:
    """Weighted mean over pixels of -log p. CUDA has no kernel for it on pictures that gives the same sum twice: there it is
    written out.
    """
    if not logits.is_cuda:
        return cross_entropy(logits, label, weight=weight)
    return written_out(logits, label, weight)


def written_out(logits: Tensor, label: Tensor, weight: Tensor) -> Tensor:
    """The same as products and sums."""
    log_p = (logits.log_softmax(1) * one_hot(label, logits.shape[1]).movedim(-1, 1)).sum(1)
    share = weight[label]
    return -(share * log_p).sum() / share.sum()


def missed(logits: Tensor, label: Tensor) -> Tensor:
    """1 - Dice of the affordances of each sequence, all classes of its pixels together, on average over sequences."""
    found, true = logits.softmax(1)[:, :BACKGROUND], one_hot(label, logits.shape[1]).movedim(-1, 1)[:, :BACKGROUND]
    both, all_ = (found * true).sum((1, 2, 3)), found.sum((1, 2, 3)) + true.sum((1, 2, 3))
    return (1 - (2 * both + 1) / (all_ + 1)).mean()
