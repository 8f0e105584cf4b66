"""Threshold of a prediction: the one with the largest expected IoU, lower where a model is less sure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from afford.common.masks import iou
from afford.twohands.model.interface import ModelConfig, build
from afford.twohands.model.predictor import Predictor
from afford.twohands.model.region_threshold import LEAST, SIDE_PX, region_cut

SIZE = (64, 96)


def blob(peak: float, size: tuple[int, int] = (40, 60)) -> np.ndarray:
    """Probabilities (1, h, w) float32 that fall from `peak` in the middle to 0."""
    y, x = (np.linspace(-3, 3, side) for side in size)
    return (peak * np.exp(-(y[:, None] ** 2 + x**2) / 2))[None].astype(np.float32)


@pytest.mark.parametrize("peak", [0.95, 0.4, 0.1])
def test_no_other_threshold_has_a_larger_mean_iou_over_drawn_truths(peak: float) -> None:
    likely = blob(peak)
    rng = np.random.default_rng(0)
    truths = rng.random((200, *likely.shape[1:])) < likely

    def mean_iou(threshold: float) -> float:
        return float(np.mean([iou(likely[0] > threshold, truth) for truth in truths]))

    best = max(mean_iou(float(threshold)) for threshold in np.linspace(0.01, 0.9, 60) * peak)
    assert mean_iou(region_cut(likely).threshold) > best - 0.005


def test_a_less_sure_model_keeps_more_than_the_threshold_of_a_sure_one() -> None:
    at = [region_cut(blob(peak)).threshold for peak in (0.95, 0.5, 0.2)]
    assert at[0] > at[1] > at[2]
    assert (blob(0.2) > at[2]).sum() > (blob(0.2) > at[0]).sum()


def test_hands_that_act_share_one_threshold() -> None:
    sure, unsure = blob(0.9), blob(0.3)
    both = region_cut(np.concatenate([sure, unsure])).threshold
    assert region_cut(unsure).threshold < both < region_cut(sure).threshold


@pytest.mark.parametrize("value", [0.0, LEAST / 2])
def test_a_picture_without_an_object_keeps_an_empty_region(value: float) -> None:
    likely = np.full((1, 30, 40), value, np.float32)
    assert not (likely > region_cut(likely).threshold).any()


def test_certain_pixels_are_the_region() -> None:
    likely = np.zeros((1, 30, 40), np.float32)
    likely[0, 5:9, 5:9] = 1
    assert ((likely > region_cut(likely).threshold) == (likely == 1)).all()


def test_a_large_picture_has_nearly_the_threshold_of_a_small_one() -> None:
    small, large = blob(0.6, (SIDE_PX, SIDE_PX)), blob(0.6, (5 * SIDE_PX, 5 * SIDE_PX))
    assert region_cut(large).threshold == pytest.approx(region_cut(small).threshold, rel=0.02)


def test_a_model_without_calibration_keeps_the_threshold_of_its_validation() -> None:
    torch.manual_seed(0)
    model = build(ModelConfig(size_px=SIZE, threshold=0.4), 0)
    image = np.random.default_rng(0).integers(0, 256, (*SIZE, 3), np.uint8)
    assert Predictor(model).predict(image, "pour tea").threshold == 0.4
    model.config = replace(model.config, calibration=(0.5, -0.3))
    found = Predictor(model).predict(image, "pour tea", "right")
    assert found.threshold == region_cut(found.probability[1:, found.score[1].argmax()]).threshold != 0.4
