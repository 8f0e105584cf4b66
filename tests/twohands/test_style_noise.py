"""Noise on the style of features: what it changes, and what it leaves."""

from __future__ import annotations

import torch

from afford.twohands.model.style_noise import with_style_noise


def features(count: int) -> list[torch.Tensor]:
    """Features of `count` samples at two strides."""
    generator = torch.Generator().manual_seed(0)
    return [torch.randn(count, 6, 8 // n, 10 // n, generator=generator) + 2 for n in (1, 2)]


def test_equal_seeds_give_equal_noise() -> None:
    first, again, other = (with_style_noise(features(16), 0.3, seed) for seed in (5, 5, 6))
    assert all(torch.equal(a, b) for a, b in zip(first, again, strict=True))
    assert not any(torch.equal(a, b) for a, b in zip(first, other, strict=True))


def test_noise_changes_the_scale_and_the_mean_of_channels_alone() -> None:
    """Each channel shows the same apart from its mean and scale; about half of the samples are as before in all."""
    before = features(400)
    after = with_style_noise(before, 0.3, 1)
    same = torch.stack([(a == b).flatten(1).all(1) for a, b in zip(before, after, strict=True)])
    assert bool((same[0] == same[1]).all()) and 160 < int(same[0].sum()) < 240
    for a, b in zip(before, after, strict=True):
        plain, noisy = (x - x.mean((2, 3), keepdim=True) for x in (a, b))
        wide, narrow = (x.std((2, 3), keepdim=True) for x in (plain, noisy))
        assert torch.allclose((plain * narrow).abs(), (noisy * wide).abs(), atol=1e-4)
        changed = ~same[0]
        assert torch.isclose((b.std((2, 3)) / a.std((2, 3)))[changed].std(), torch.tensor(0.3), atol=0.05)
        assert torch.isclose(((b - a).mean((2, 3)) / a.std((2, 3)))[changed].std(), torch.tensor(0.3), atol=0.05)


def test_a_channel_of_one_place_stays_finite() -> None:
    """Such a channel has no scale to shift by."""
    (one,) = with_style_noise([torch.ones(8, 3, 1, 1)], 0.3, 2)
    assert torch.equal(one, torch.ones(8, 3, 1, 1))
