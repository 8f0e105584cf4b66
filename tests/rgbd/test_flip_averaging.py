"""Asked both ways: a mirrored sequence gets the mirrored answer, and mirrored tensors are those of a mirrored sequence."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from afford.dataset.packed_sequences import PackedSequence
from afford.rgbd.model import model_inputs
from afford.rgbd.model.config import Sor3dConfig, row
from afford.rgbd.model.model import Sor3d, build, flip_inputs, predict_with_flip
from afford.rgbd.model.model_inputs import InputBatch, ModelInput, to_batch
from tests.helpers.made_sequences import SIZE
from tests.helpers.made_sequences import seen as noise

WIDTHS = (4, 4, 8, 8)


@pytest.fixture(params=["rgb", "rgb_attention_flow2d", "rgbd_attention_flow3d"])
def model(request: pytest.FixtureRequest) -> Sor3d:
    return build(row(Sor3dConfig(size_px=SIZE, widths=WIDTHS), request.param), 3).eval()


def shown(model: Sor3d, turned: bool = False) -> InputBatch:
    one = noise(5)
    if turned:
        whole = model_inputs.flip_sequence(PackedSequence("noise", "can", "lift", *one, np.zeros((SIZE, SIZE), np.uint8)))
        one = ModelInput(whole.rgb, whole.depth_m, whole.flow, whole.still)
    return to_batch([one], model.config)


@torch.inference_mode()
def test_flip_averaging_is_equivariant(model: Sor3d) -> None:
    """Equal up to rounding; a single prediction is not, so averaging matters."""
    seen = shown(model)
    said, other = predict_with_flip(model, seen), predict_with_flip(model, flip_inputs(seen))
    assert torch.allclose(said.logits, other.logits.flip(-1), atol=1e-5)
    assert torch.allclose(said.action, other.action, atol=1e-5)
    assert not torch.allclose(model(seen).logits, model(flip_inputs(seen)).logits.flip(-1), atol=1e-5)
    if said.attention is not None and other.attention is not None:
        assert torch.allclose(said.attention, other.attention.flip(-1), atol=1e-5)


@torch.inference_mode()
def test_flip_averaging_is_the_mean_of_both(model: Sor3d) -> None:
    """Probabilities still sum to 1 and lie between the two."""
    seen = shown(model)
    said = predict_with_flip(model, seen).logits.exp()
    one, two = model(seen).logits.softmax(1), model(flip_inputs(seen)).logits.softmax(1).flip(-1)
    assert torch.allclose(said.sum(1), torch.ones_like(said[:, 0]), atol=1e-5)
    assert ((said >= torch.minimum(one, two) - 1e-6) & (said <= torch.maximum(one, two) + 1e-6)).all()


def test_mirrored_tensors_are_those_of_a_mirrored_sequence(model: Sor3d) -> None:
    """Appearance to the bit; motion to the step of its colours, which cannot go beyond their ends."""
    ours, theirs = flip_inputs(shown(model)), shown(model, turned=True)
    assert torch.equal(ours.appearance, theirs.appearance)
    assert torch.allclose(ours.motion, theirs.motion, atol=0.1)
    twice = flip_inputs(flip_inputs(shown(model)))
    assert torch.equal(twice.motion, shown(model).motion) and torch.equal(twice.appearance, shown(model).appearance)
