"""Predictions averaged over a picture and its mirror image."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from afford.common.text import swap_sides
from afford.twohands.model.interface import ModelConfig, build
from afford.twohands.model.predictor import Predictor, RawPrediction, merge_mirrored, mirror_image
from schemas.affordance import MIRRORED

TINY = ModelConfig(size_px=(64, 96), widths=(16, 16, 32), depth=1, decoder_depth=1, text_buckets=64, threshold=0.5)
TASK = "take the left cup"


def picture(seed: int) -> np.ndarray:
    """Smooth noise that fills the model's input."""
    coarse = np.random.default_rng(seed).integers(0, 255, (8, 12, 3), np.uint8)
    return np.repeat(np.repeat(coarse, 8, 0), 8, 1)


def raw_prediction(seed: int, k: int = 3) -> RawPrediction:
    """Any answer."""
    rng = np.random.default_rng(seed)
    probability, score = rng.random((2, k, 6, 8), np.float32), torch.from_numpy(rng.normal(size=(2, k)))
    return RawPrediction(probability, score, rng.dirichlet(np.ones(4)), None)


def of_mirror(one: RawPrediction, order: list[int]) -> RawPrediction:
    """Prediction of a side-blind model for the mirror image, with its regions in another order."""
    return RawPrediction(one.probability[::-1, order, :, ::-1], one.score.flip(0)[:, order], one.taxonomy[list(MIRRORED)], None)


@pytest.mark.parametrize("seed", range(3))
def test_a_mirrored_question_has_the_mirrored_answer(seed: int) -> None:
    """A mirrored picture with exchanged words gives the mirrored regions of the other hand, for any model."""
    predictor, image = Predictor(build(TINY, seed)), picture(seed)
    here, there = predictor.predict(image, TASK), predictor.predict(mirror_image(image), swap_sides(TASK))
    assert there.taxonomy == pytest.approx(here.taxonomy[list(MIRRORED)], abs=1e-5)
    expected, found = (one.probability.mean(1) for one in (here, there))
    assert np.allclose(found[::-1, :, ::-1], expected, atol=1e-4) and expected.std() > 0.001


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1], [1, 0, 2]])
def test_equal_predictions_are_not_changed(order: list[int]) -> None:
    """Each region is averaged with itself, for any order of the regions."""
    one = raw_prediction(0)
    both = merge_mirrored(one, of_mirror(one, order))
    assert np.allclose(both.probability, one.probability) and both.taxonomy == pytest.approx(one.taxonomy)
    assert torch.allclose(both.score.softmax(-1), one.score.softmax(-1))


def test_one_of_the_two_alone_changes_half() -> None:
    """Regions lie between both opinions, in the middle."""
    one, other = raw_prediction(1, k=1), raw_prediction(2, k=1)
    both = merge_mirrored(one, of_mirror(other, [0]))
    assert np.allclose(both.probability, (one.probability + other.probability) / 2)


def test_a_mirror_can_be_left_out() -> None:
    """Then the model is asked once."""
    model, image = build(TINY, 0), picture(0)
    alone, with_mirror = (Predictor(model, mirror=m).predict(image, TASK, looks=1) for m in (False, True))
    assert not np.allclose(alone.probability, with_mirror.probability)
