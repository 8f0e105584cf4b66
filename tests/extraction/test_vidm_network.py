"""The parts of VIDM compute what the published code says, written out here once more and plainly."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from afford.extraction.inpaint.vidm_model import BETAS, STEPS, ddim
from afford.extraction.inpaint.vidm_unet import Attention, Unet
from tests.helpers.tiny_inpainters import VIDM


def test_vidm_steps_are_those_of_the_published_sampler() -> None:
    """Times, alphas and noise of every step: c = 1000 // steps, times 1, 1 + c, ...; the last ends at the first alpha."""
    steps, eta = 8, 1.0
    betas = np.linspace(BETAS[0] ** 0.5, BETAS[1] ** 0.5, STEPS) ** 2
    alphas = np.cumprod(1 - betas)
    times = np.arange(0, STEPS, STEPS // steps) + 1
    before = np.array([alphas[0], *alphas[times[:-1]]])
    sigma = eta * np.sqrt((1 - before) / (1 - alphas[times]) * (1 - alphas[times] / before))
    scheduler = ddim(steps)
    assert scheduler.timesteps.tolist() == times[::-1].tolist()
    x, guess = torch.full((1, 1), 0.3), torch.full((1, 1), -0.2)
    for time, now, then, noise in zip(times, alphas[times], before, sigma, strict=True):
        found = scheduler.step(guess, int(time), x, eta=eta, variance_noise=torch.ones(1, 1)).prev_sample
        clean = (0.3 + 0.2 * np.sqrt(1 - now)) / np.sqrt(now)
        wanted = np.sqrt(then) * clean - 0.2 * np.sqrt(1 - then - noise**2) + noise
        assert float(found) == pytest.approx(wanted, rel=1e-4)


@torch.no_grad()
def test_vidm_attention_splits_heads_before_queries_keys_and_values() -> None:
    """Channels have the published order: head by head, and in each head queries, keys, values."""
    torch.manual_seed(0)
    layer, x = Attention(32, 4), torch.randn(1, 32, 4, 2, 3)
    flat = torch.nn.functional.group_norm(x.flatten(2), 32)
    q, k, v = layer.qkv(flat).reshape(4, 24, 24).split(8, 1)
    weight = torch.einsum("hct,hcs->hts", q, k).div(8**0.5).softmax(-1)
    wanted = x.flatten(2) + layer.proj_out(torch.einsum("hts,hcs->hct", weight, v).reshape(1, 32, 24))
    assert torch.allclose(layer(x).flatten(2), wanted, atol=1e-5)


@torch.no_grad()
def test_vidm_joins_frames_in_their_order() -> None:
    """One picture comes out of four; context in another order is another picture, a batch of two is twice one."""
    torch.manual_seed(0)
    unet, x, step = Unet(VIDM).eval(), torch.randn(2, 7, 4, 8, 8), torch.tensor([1, 900])
    out = unet(x, step)
    assert out.shape == (2, 3, 8, 8)
    assert torch.allclose(out[1:], unet(x[1:], step[1:]), atol=1e-5)
    assert not torch.allclose(out, unet(x[:, :, [1, 0, 2, 3]], step), atol=1e-3)
    assert not torch.allclose(out, unet(x, step.flip(0)), atol=1e-4)
