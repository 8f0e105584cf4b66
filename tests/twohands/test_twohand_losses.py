"""Losses of the two-hand models: numbers by hand, MONAI as an independent reference, and the laws of multiple choice."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from afford.twohands.model.interface import Output, Target
from afford.twohands.model.losses import (
    LossParams,
    bce,
    best_hypothesis,
    centre_loss,
    dice,
    focal,
    hypothesis_shares,
    losses,
    taxonomy_loss,
)


def output(b: int = 3, k: int = 3, seed: int = 0) -> Output:
    g = torch.Generator().manual_seed(seed)
    return Output(torch.randn(b, 2, k, 8, 12, generator=g), torch.randn(b, 2, k, generator=g), torch.randn(b, 4, generator=g))


def target(b: int = 3, seed: int = 1) -> Target:
    g = torch.Generator().manual_seed(seed)
    label = torch.tensor([0, 1, 2])[:b]
    active = torch.stack([label != 1, label != 0], dim=1)
    masks = (torch.rand(b, 2, 32, 48, generator=g) > 0.7).float() * active[..., None, None]
    return Target(masks, active, label)


def flipped(o: Output) -> Output:
    return Output(o.logits.flip(1).flip(-1), o.score.flip(1), o.taxonomy[:, [1, 0, 2, 3]])


def test_dice_by_hand() -> None:
    """One pixel, p = 1/2, truth 1: the oracle that the released formula gives."""
    assert dice(torch.zeros(1, 1), torch.ones(1, 1)).item() == pytest.approx(1 - 0.001001 / 0.001501, abs=1e-7)


def test_dice_is_zero_on_the_truth_and_one_off_it() -> None:
    """A certain and right mask costs nothing, a certain and wrong one costs all."""
    truth = torch.zeros(64, 64)
    truth[:32] = 1
    certain = 200 * truth - 100
    assert dice(certain, truth).item() == pytest.approx(0, abs=1e-6)
    assert dice(-certain, truth).item() == pytest.approx(1, abs=1e-5)


@pytest.mark.parametrize("gamma", [0.0, 2.0, 3.0])
def test_focal_and_dice_agree_with_monai(gamma: float) -> None:
    """MONAI's own sums, on random masks."""
    from monai.losses import DiceLoss, FocalLoss

    o, t = output().logits[:, 0, :1], target().masks[:, :1, :8, :12]
    wanted = FocalLoss(gamma=gamma, alpha=0.25)(o, t)
    assert focal(o, t, 0.25, gamma).mean().item() == pytest.approx(wanted.item(), rel=1e-5)
    wanted = DiceLoss(sigmoid=True, smooth_nr=1e-3, smooth_dr=1e-3)(o, t)  # eps times the scale
    assert dice(o, t).mean().item() == pytest.approx(wanted.item(), rel=1e-5)


def test_the_object_loss_is_that_of_active_hands() -> None:
    """The object of an idle hand has no loss, an exact prediction has none either, and the total counts the loss by its weight."""
    o, t = output(), target()
    things = (torch.rand(3, 2, 8, 12, generator=torch.Generator().manual_seed(4)) > 0.5).float()
    exact = 200 * things - 100
    told = t._replace(objects=things)
    assert losses(o._replace(objects=exact), told, LossParams())["object"].item() == pytest.approx(0, abs=1e-5)
    idle = exact.clone()
    idle[0, 1] *= -1
    assert not t.active[0, 1]
    assert losses(o._replace(objects=idle), told, LossParams())["object"].item() == pytest.approx(0, abs=1e-5)
    wrong = o._replace(objects=-exact)
    one, two = (losses(wrong, told, LossParams(object_weight=weight)) for weight in (1.0, 2.0))
    assert (two["total"] - one["total"]).item() == pytest.approx(one["object"].item(), rel=1e-5) and one["object"] > 1
    assert "object" not in losses(wrong, t, LossParams()) and "object" not in losses(o, told, LossParams())


def test_the_centre_costs_where_it_is_known() -> None:
    """Near the truth the square over twice beta, far from it the distance; nothing where it is unknown, and no NaN anywhere."""
    told = torch.tensor([[0.05, 0.0], [1.05, 0.0], [7.0, 7.0]], requires_grad=True)
    truth = torch.tensor([[0.0, 0.0], [0.0, 0.0], [math.nan, math.nan]])
    cost = centre_loss(told, truth)
    assert cost.item() == pytest.approx((0.05**2 / 0.2 + 1.0) / 4, abs=1e-6)
    cost.backward()
    assert told.grad is not None and told.grad.isfinite().all() and not told.grad[2].any()
    assert centre_loss(told, torch.full_like(truth, math.nan)).item() == 0
    named = losses(output()._replace(centre=told), target()._replace(centre=truth), LossParams(centre_weight=0.5))
    assert named["centre"].item() == pytest.approx(cost.item())


def test_focal_without_focus_is_half_the_cross_entropy() -> None:
    """gamma 0 and alpha 1/2 leave BCE / 2."""
    o, t = output().logits[:, 0, :1], target().masks[:, :1, :8, :12]
    assert torch.allclose(focal(o, t, 0.5, 0.0), bce(o, t) / 2)


def test_taxonomy_modes_by_hand() -> None:
    """Equal logits cost log 4 in both modes; a certain right answer costs 0 on logits, and log(1 + 3/e) on a softmax."""
    even, sure, label = torch.zeros(1, 4), torch.tensor([[100.0, 0, 0, 0]]), torch.tensor([0])
    assert taxonomy_loss(even, label, "paper").item() == taxonomy_loss(even, label, "code").item() == pytest.approx(math.log(4))
    assert taxonomy_loss(sure, label, "paper").item() == pytest.approx(0, abs=1e-6)
    assert taxonomy_loss(sure, label, "code").item() == pytest.approx(math.log(1 + 3 / math.e), abs=1e-6)


def test_an_idle_hand_changes_nothing_in_paper_mode() -> None:
    """Neither its logits, nor its masks, nor its place in the normaliser."""
    o, t = output(), target()
    noise = torch.where(t.active[..., None, None, None], 0.0, 50.0)
    other = o._replace(logits=o.logits + noise)
    messy = t._replace(masks=t.masks + (~t.active)[..., None, None].float())
    for name, value in losses(o, t, LossParams()).items():
        assert torch.equal(value, losses(other, messy, LossParams())[name]), name
    alone = losses(*_only(o, t, 0), LossParams(epsilon=0))
    both = t._replace(active=torch.ones(3, 2, dtype=torch.bool))
    assert losses(*_only(o, both, 0), LossParams(epsilon=0))["mask"] != alone["mask"]


def test_an_idle_hand_stays_as_a_constant_in_code_mode() -> None:
    """k = 1, one idle hand: BCE of zero logits is log 2, its gradient is zero, and the sum is divided by the samples."""
    o, t = _only(output(k=1), target(), 0)
    logits = o.logits.clone().requires_grad_()
    found = losses(o._replace(logits=logits), t, LossParams(mode="code", grid="input"))
    large = torch.nn.functional.interpolate(o.logits[:, 0], (32, 48), mode="bilinear", align_corners=False)
    assert found["mask"].item() == pytest.approx(bce(large, t.masks[:, :1]).item() + math.log(2), rel=1e-5)
    found["total"].backward()
    assert logits.grad is not None and not logits.grad[:, 1].any() and logits.grad[:, 0].any()


def test_mirrored_hands_cost_the_same() -> None:
    """Flip the picture and swap the hands, in the answer and in the truth: every loss stays."""
    o, t = output(), target()
    mirror = Target(t.masks.flip(1).flip(-1), t.active.flip(1), torch.tensor([1, 0, 2, 3])[t.taxonomy])
    for mode in ("paper", "code"):
        one, two = losses(o, t, LossParams(mode=mode)), losses(flipped(o), mirror, LossParams(mode=mode))
        assert all(torch.allclose(one[name], two[name], atol=1e-6) for name in one)


@pytest.mark.parametrize("choice", ["joint", "hand"])
def test_the_order_of_hypotheses_does_not_matter(choice: str) -> None:
    """Permute them, with their scores: every loss stays."""
    o, t, order = output(), target(), [2, 0, 1]
    mixed = o._replace(logits=o.logits[:, :, order], score=o.score[:, :, order])
    one, two = (losses(x, t, LossParams(choice=choice)) for x in (o, mixed))
    assert all(torch.allclose(one[name], two[name], atol=1e-6) for name in one)


def test_copies_of_one_hypothesis_cost_what_one_costs() -> None:
    """k equal hypotheses give the mask loss of k = 1, whatever epsilon shares out."""
    o, t = output(k=1), target()
    many = o._replace(logits=o.logits.expand(-1, -1, 4, -1, -1), score=o.score.expand(-1, -1, 4))
    one, four = losses(o, t, LossParams()), losses(many, t, LossParams(epsilon=0.3))
    assert torch.allclose(one["mask"], four["mask"]) and torch.allclose(one["dice"], four["dice"])
    assert one["score"].item() == 0 and four["score"].item() == pytest.approx(math.log(4), abs=1e-5)


def test_joint_choice_takes_the_pair_and_ignores_idle_hands() -> None:
    """Left alone would take 0, right alone 1; together 2 is cheapest. An idle hand has no say."""
    cost = torch.tensor([[[0.0, 5.0, 1.0], [5.0, 0.0, 1.0]]])
    both, left = torch.ones(1, 2), torch.tensor([[1.0, 0.0]])
    assert best_hypothesis(cost, both, "joint").tolist() == [[2, 2]]
    assert best_hypothesis(cost, both, "hand").tolist() == [[0, 1]]
    assert best_hypothesis(cost, left, "joint").tolist() == [[0, 0]]


def test_the_best_takes_the_gradient_and_the_others_a_little() -> None:
    """Gradients of the masks are in the proportion that epsilon says, and none is dead."""
    shares = hypothesis_shares(torch.tensor([[1, 0]]), 3, 0.1).tolist()
    assert shares == [[pytest.approx([0.05, 0.9, 0.05]), pytest.approx([0.9, 0.05, 0.05])]]
    o, t = output(), target()
    logits = o.logits.clone().requires_grad_()
    losses(o._replace(logits=logits), t, LossParams())["total"].backward()
    assert logits.grad is not None
    moved = logits.grad.abs().sum((-1, -2))[t.active]
    assert (moved > 0).all() and (moved.amax(1) > 5 * moved.median(1).values).all()


def test_grids_agree_on_masks_that_are_coarse_anyway() -> None:
    """Both grids give zero loss when each 4 x 4 block is full or empty and logits are certain."""
    coarse = target().masks[:, :, :8, :12]
    t = target()._replace(masks=coarse.repeat_interleave(4, -1).repeat_interleave(4, -2))
    o = output(k=1)._replace(logits=(200 * coarse - 100)[:, :, None])
    assert losses(o, t, LossParams())["dice"].item() == pytest.approx(0, abs=1e-5)
    assert losses(o, t, LossParams(grid="input"))["dice"].item() < 0.4  # bilinear edges, nothing more


def test_total_is_the_weighted_sum_with_the_text() -> None:
    """The total is each named loss times its own weight."""
    params = LossParams(mask_weight=3, dice_weight=0.25, score_weight=2, taxonomy_weight=0.5, text_weight=0.1)
    found = losses(output()._replace(text_loss=torch.tensor(7.0)), target(), params)
    wanted = 3 * found["mask"] + found["dice"] / 4 + 2 * found["score"] + found["taxonomy"] / 2 + 0.7
    assert torch.allclose(found["total"], wanted)


def test_unknown_names_are_refused() -> None:
    """A misspelt mode says which ones there are."""
    with pytest.raises(ValueError, match=r"LossParams\.mode: expected one of .*paper"):
        LossParams(mode="papr")


def _only(o: Output, t: Target, i: int) -> tuple[Output, Target]:
    def pick(x: Tensor) -> Tensor:
        return x[i : i + 1]

    return Output(pick(o.logits), pick(o.score), pick(o.taxonomy)), Target(*map(pick, t[:3]))
