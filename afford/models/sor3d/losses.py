"""What is learned: the classes of the pixels of the last frame, and the action."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import cross_entropy

from afford.models.sor3d.model import Said
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
    foreground: float = 1.0
    """weight of pixels that are not background; 1 in the paper. The mean is a weighted one"""

    def weights(self, done: float) -> tuple[float, float]:
        """l1, l2 when a share `done` of the steps is done."""
        return self.early if done < self.turn else self.late


def losses(said: Said, label: Tensor, action: Tensor, params: LossParams, done: float) -> dict[str, Tensor]:
    """`label` (n, h, w) int64 of the last frame, `action` (n,) int64. Nothing else of a sequence has a label."""
    classes = torch.full((said.logits.shape[1],), params.foreground, device=said.logits.device)
    classes[BACKGROUND] = 1.0
    pixels = cross_entropy(said.logits.float(), label, weight=classes)
    told = cross_entropy(said.action.float(), action)
    first, second = params.weights(done)
    return {"total": first * pixels + second * told, "pixels": pixels, "action": told}
