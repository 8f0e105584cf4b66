"""Losses of SOR3D-AFF: classes of the pixels of the last frame, and the action."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy, one_hot

from afford.rgbd.model.model import Sor3dOutput
from schemas.interaction import BACKGROUND


@dataclass(frozen=True)
class LossParams:
    """Weights of the losses: total = l1 * mean over pixels of -log p + l2 * cross-entropy of the action (SOR3D-AFF)."""

    early: tuple[float, float] = (0.2, 0.8)
    """l1, l2 until `turn`"""
    late: tuple[float, float] = (0.5, 0.5)
    """l1, l2 from `turn` on"""
    turn: float = 0.75
    """share of the steps (150 of 200 epochs in the paper)"""
    dice: float = 0.0
    """weight of the Dice loss of the affordances relative to l1's mean (Milletari et al. 2016); 0 in the paper"""
    foreground: float = 1.0
    """weight of pixels that are not background in the weighted mean; 1 in the paper"""

    def weights(self, done: float) -> tuple[float, float]:
        """Return l1, l2 after a share `done` of the steps."""
        return self.early if done < self.turn else self.late


def losses(output: Sor3dOutput, label: Tensor, action: Tensor, params: LossParams, done: float) -> dict[str, Tensor]:
    """Compute the losses by name from `label` (n, h, w) int64 of the last frame and `action` (n,) int64.

    No other frame of a sequence has a label.
    """
    classes = torch.full((output.logits.shape[1],), params.foreground, device=output.logits.device)
    classes[BACKGROUND] = 1.0
    pixels = pixel_cross_entropy(output.logits.float(), label, classes)
    action_loss = cross_entropy(output.action.float(), action)
    dice = dice_loss(output.logits.float(), label)
    first, second = params.weights(done)
    total = first * (pixels + params.dice * dice) + second * action_loss
    return {"total": total, "pixels": pixels, "dice": dice, "action": action_loss}


def pixel_cross_entropy(logits: Tensor, label: Tensor, weight: Tensor) -> Tensor:
    """Weighted mean over pixels of -log p.

    CUDA has no deterministic kernel for it on pictures, so on CUDA it is computed from products and sums.
    """
    if not logits.is_cuda:
        return cross_entropy(logits, label, weight=weight)
    return explicit_cross_entropy(logits, label, weight)


def explicit_cross_entropy(logits: Tensor, label: Tensor, weight: Tensor) -> Tensor:
    """Compute `pixel_cross_entropy` from products and sums."""
    log_p = (logits.log_softmax(1) * one_hot(label, logits.shape[1]).movedim(-1, 1)).sum(1)
    share = weight[label]
    return -(share * log_p).sum() / share.sum()


def dice_loss(logits: Tensor, label: Tensor) -> Tensor:
    """1 - Dice of the affordances of each sequence, over all classes of its pixels together, averaged over sequences."""
    found, true = logits.softmax(1)[:, :BACKGROUND], one_hot(label, logits.shape[1]).movedim(-1, 1)[:, :BACKGROUND]
    both, all_ = (found * true).sum((1, 2, 3)), found.sum((1, 2, 3)) + true.sum((1, 2, 3))
    return (1 - (2 * both + 1) / (all_ + 1)).mean()
