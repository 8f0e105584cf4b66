"""Losses of the two-hand models (2HandedAfforder section 4), as in the paper and as in the released code.

Several regions may be right for one task, but a sample shows one of them. So the k hypotheses are trained by multiple choice
learning (Guzman-Rivera et al. 2012; the share `epsilon` for the others as in Rupprecht et al. 2017): the hypothesis with the lowest
loss is trained on the sample, and the scores learn which one that is.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits, cross_entropy, interpolate, one_hot, smooth_l1_loss, softmax

from afford.twohands.model.interface import Output, Target

ALLOWED = {"mode": ("paper", "code"), "mask": ("", "focal", "bce"), "choice": ("joint", "hand"), "grid": ("output", "input")}


@dataclass(frozen=True)
class LossParams:
    """Weights and modes of the losses; defaults of the paper."""

    mode: str = "paper"
    """paper: no mask loss for an idle hand, taxonomy loss on logits | code: constant mask loss for an idle hand, on softmax"""
    mask: str = ""
    """focal | bce; '' is focal in paper mode and bce in code mode"""
    choice: str = "joint"
    """joint: the pair of both hands' regions is one hypothesis | hand: the best hypothesis of each hand by itself"""
    epsilon: float = 0.1
    """share of the mask loss of all other hypotheses together, so that each of them is trained"""
    grid: str = "output"
    """size at which masks are compared: output = that of the logits, truth is the covered share | input = that of the image"""
    mask_weight: float = 2.0
    dice_weight: float = 0.5
    taxonomy_weight: float = 1.0
    text_weight: float = 1.0
    score_weight: float = 0.5
    object_weight: float = 1.0
    centre_weight: float = 1.0
    focal_alpha: float = 0.25
    focal_gamma: float = 2.0
    dice_scale: float = 1000.0
    dice_eps: float = 1e-6

    def __post_init__(self) -> None:
        for name, values in ALLOWED.items():
            if getattr(self, name) not in values:
                raise ValueError(f"LossParams.{name}: expected one of {values}, got {getattr(self, name)!r}")


def losses(output: Output, target: Target, params: LossParams) -> dict[str, Tensor]:
    """Compute the named scalars mask, dice, score, taxonomy, optionally object, centre and text, and their weighted sum `total`."""
    active = target.active.float()
    mask, overlap = mask_costs(output.logits, target.masks, active, params)
    best = best_hypothesis((params.mask_weight * mask + params.dice_weight * overlap).detach(), active, params.choice)
    share = hypothesis_shares(best, output.score.shape[-1], params.epsilon)
    if params.mode == "paper":
        share, count = share * active[..., None], active.sum()
    else:
        count = active.new_tensor(len(active))
    named = {"mask": (mask * share).sum() / (count + 1e-8), "dice": (overlap * share).sum() / (count + 1e-8),
             "score": score_loss(output.score.float(), best, active),
             "taxonomy": taxonomy_loss(output.taxonomy.float(), target.taxonomy, params.mode)}  # fmt: skip
    if output.objects is not None and target.objects is not None:
        named["object"] = object_loss(output.objects, target.objects, active, params)
    if output.centre is not None and target.centre is not None:
        named["centre"] = centre_loss(output.centre, target.centre)
    if output.text_loss is not None:
        named["text"] = output.text_loss
    weighted = [getattr(params, f"{name}_weight") * value for name, value in named.items()]
    return named | {"total": torch.stack(weighted).sum()}


def mask_costs(logits: Tensor, masks: Tensor, active: Tensor, params: LossParams) -> tuple[Tensor, Tensor]:
    """Focal loss or BCE, and Dice loss, of every hypothesis: twice (b, 2, k). Code mode multiplies an idle hand's logits by 0."""
    logits, truth = on_one_grid(logits.float(), masks, params.grid)
    if params.mode == "code":
        logits = logits * active[..., None, None, None]
    overlap = dice(logits, truth, params.dice_scale, params.dice_eps)
    if (params.mask or {"paper": "focal", "code": "bce"}[params.mode]) == "bce":
        return bce(logits, truth), overlap
    return focal(logits, truth, params.focal_alpha, params.focal_gamma), overlap


def on_one_grid(logits: Tensor, masks: Tensor, grid: str) -> tuple[Tensor, Tensor]:
    """Resize logits (b, 2, k, h, w) or masks (b, 2, H, W) to one size; masks become (b, 2, 1, ., .)."""
    if grid == "input":
        large = interpolate(logits.flatten(1, 2), masks.shape[-2:], mode="bilinear", align_corners=False)
        return large.unflatten(1, logits.shape[1:3]), masks[:, :, None]
    return logits, interpolate(masks, logits.shape[-2:], mode="area")[:, :, None]


def dice(logits: Tensor, truth: Tensor, scale: float = 1000.0, eps: float = 1e-6) -> Tensor:
    """Dice loss of LISA over the last two axes; the other axes broadcast."""
    p = logits.sigmoid()
    overlap = 2 * (p / scale * truth).sum((-1, -2))
    return 1 - (overlap + eps) / ((p / scale).sum((-1, -2)) + (truth / scale).sum((-1, -2)) + eps)


def focal(logits: Tensor, truth: Tensor, alpha: float = 0.25, gamma: float = 2.0) -> Tensor:
    """Focal loss (Lin et al. 2017), mean over the last two axes; `truth` may be a share between 0 and 1."""
    p, truth = logits.sigmoid(), truth.expand_as(logits)
    missed = p + truth - 2 * p * truth  # 1 - p where it is true, p where it is not
    balance = alpha * truth + (1 - alpha) * (1 - truth)
    return (balance * missed**gamma * binary_cross_entropy_with_logits(logits, truth, reduction="none")).mean((-1, -2))


def bce(logits: Tensor, truth: Tensor) -> Tensor:
    """Binary cross-entropy, mean over the last two axes."""
    return binary_cross_entropy_with_logits(logits, truth.expand_as(logits), reduction="none").mean((-1, -2))


def best_hypothesis(cost: Tensor, active: Tensor, choice: str) -> Tensor:
    """Index (b, 2) of the hypothesis with the lowest cost (b, 2, k), given the hands that act (b, 2)."""
    if choice == "joint":
        cost = (cost * active[..., None]).sum(1, keepdim=True).expand_as(cost)
    return cost.argmin(-1)


def score_loss(score: Tensor, best: Tensor, active: Tensor) -> Tensor:
    """Cross-entropy of the scores (b, 2, k) towards the best hypothesis (b, 2), over active hands; scalar."""
    each = cross_entropy(score.flatten(0, 1), best.flatten(), reduction="none").view_as(active)
    return (each * active).sum() / (active.sum() + 1e-8)


def taxonomy_loss(logits: Tensor, label: Tensor, mode: str) -> Tensor:
    """Cross-entropy of the 4 classes; mode `code` applies the softmax twice, as the released code does."""
    return cross_entropy(logits if mode == "paper" else softmax(logits, -1), label)


def hypothesis_shares(best: Tensor, count: int, epsilon: float) -> Tensor:
    """Weight (b, 2, k) of each hypothesis: 1 - epsilon for the best one (b, 2), the rest divided among the others."""
    if count == 1:
        return best.new_ones((*best.shape, 1), dtype=torch.float32)
    chosen = one_hot(best, count).float()
    return chosen * (1 - epsilon) + (1 - chosen) * epsilon / (count - 1)


def object_loss(logits: Tensor, masks: Tensor, active: Tensor, params: LossParams) -> Tensor:
    """Cross-entropy plus Dice loss of the complete objects (b, 2, h, w) of the hands that act; scalar."""
    logits, truth = on_one_grid(logits[:, :, None].float(), masks, params.grid)
    each = (bce(logits, truth) + dice(logits, truth, params.dice_scale, params.dice_eps))[..., 0]
    return (each * active).sum() / (active.sum() + 1e-8)


def centre_loss(centre: Tensor, truth: Tensor) -> Tensor:
    """Huber loss of the centre of the objects (b, 2), over samples where it is known; scalar."""
    known = truth.isfinite().all(-1)
    return smooth_l1_loss(centre[known], truth[known], reduction="sum", beta=0.1) / (2 * known.sum() + 1e-8)
