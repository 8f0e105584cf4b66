"""Calibration of regions: fitted on validation pixels, applied to logits, without effect on the order of pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.special import expit, logit, softmax

from afford.twohands.benchmark.answers import of_prediction
from afford.twohands.benchmark.measures import expected_error, reliability
from afford.twohands.benchmark.predictions_file import PredictionFile, write_predictions
from afford.twohands.model.calibration import IDENTITY, TEMPERATURES, calibrated, fit_calibration, fit_temperature, tempered
from afford.twohands.model.hand_selection import hand_probabilities
from afford.twohands.model.interface import ModelConfig, build
from afford.twohands.model.predictor import Predictor
from afford.twohands.train.validation import ValidationSample, validation_metrics

SIZE = (64, 96)


def overconfident(seed: int, slope: float = 0.4, offset: float = -0.8) -> tuple[np.ndarray, np.ndarray]:
    """Probabilities (n,) of a model that is too sure, and truth (n,) that follows other logits."""
    rng = np.random.default_rng(seed)
    z = rng.normal(-1, 4, 60_000)
    return expit(z).astype(np.float32), rng.random(len(z)) < expit(slope * z + offset)


def gap(probability: np.ndarray, truth: np.ndarray) -> float:
    """Expected calibration error."""
    return expected_error(reliability(probability.astype(np.float32)[None], truth.astype(np.uint8)[None], 1, 0.05))


def test_fit_recovers_the_logits_of_the_truth() -> None:
    slope, offset = fit_calibration([(*overconfident(0), 1.0), (*overconfident(1), 1.0)])
    assert slope == pytest.approx(0.4, abs=0.02) and offset == pytest.approx(-0.8, abs=0.05)


def test_fit_removes_most_of_the_error_on_other_pixels() -> None:
    slope, offset = fit_calibration([(*overconfident(0), 1.0)])
    probability, truth = overconfident(5)
    assert gap(expit(slope * logit(probability.astype(np.float64).clip(1e-6, 1 - 1e-6)) + offset), truth) < 0.02 < 0.15 < gap(
        probability, truth)


@pytest.mark.parametrize("truth", [np.zeros(4, bool), np.ones(4, bool), np.array([True, True, False, False])])
def test_fit_without_two_classes_or_in_reverse_order_changes_nothing(truth: np.ndarray) -> None:
    assert fit_calibration([(np.array([0.1, 0.2, 0.8, 0.9], np.float32), truth, 1.0)]) == IDENTITY
    assert fit_calibration([]) == IDENTITY


def test_fit_to_perfect_predictions_is_finite() -> None:
    probability, truth = np.array([0.0, 0.1, 0.9, 1.0] * 50, np.float32), np.array([False, False, True, True] * 50)
    slope, offset = fit_calibration([(probability, truth, 1.0)])
    assert np.isfinite((slope, offset)).all() and slope > 0


def test_calibrated_probabilities_keep_their_order_and_ends() -> None:
    found = [calibrated(p, (0.4, -0.8)) for p in (0.0, 0.05, 0.2, 0.5, 0.9, 1.0)]
    assert found == sorted(found) and (found[0], found[-1]) == (0.0, 1.0) and found[3] == pytest.approx(expit(-0.8))


def test_regions_and_levels_of_a_single_look_stay_and_probabilities_move() -> None:
    torch.manual_seed(0)
    config = ModelConfig(size_px=SIZE, threshold=0.5)
    model, image = build(config, 0), np.random.default_rng(0).integers(0, 256, (*SIZE, 3), np.uint8)
    before = Predictor(model, mirror=False).predict(image, "pour tea", looks=1)
    at = (0.4, -0.8)
    model.config = replace(config, calibration=at, threshold=calibrated(0.5, at))
    after = Predictor(model, mirror=False).predict(image, "pour tea", looks=1)
    assert np.abs(after.probability - before.probability).max() > 0.05
    cut_at = calibrated(before.threshold, at)
    assert after.calibration == at and ((after.probability > cut_at) == (before.probability > before.threshold)).mean() > 0.999
    cut = [of_prediction(one, SIZE, (0.1, 0.3, 0.7), 1).cuts for one in (before, after)]
    assert (cut[0] == cut[1]).mean() > 0.999


def test_prediction_file_keeps_the_calibration(tmp_path) -> None:  # type: ignore[no-untyped-def]
    model = build(ModelConfig(size_px=SIZE, calibration=(0.5, -0.25)), 0)
    found = Predictor(model, mirror=False).predict(np.zeros((*SIZE, 3), np.uint8), "pour", looks=1)
    write_predictions(tmp_path / "p.parquet", [("a", found)])
    read = PredictionFile(tmp_path / "p.parquet").get("a")
    assert read is not None and read.calibration == (0.5, -0.25)


def test_fit_leaves_the_hand_to_the_taxonomy() -> None:
    probability, truth = overconfident(0)
    acting = [(probability, truth, 0.75)] * 3 + [(probability, np.zeros_like(truth), 0.75)]
    assert fit_calibration(acting) == pytest.approx(fit_calibration([(probability, truth, 1.0)]), abs=0.05)


def test_temperature_recovers_the_classes_shares_and_keeps_their_order() -> None:
    rng = np.random.default_rng(0)
    logits = rng.normal(0, 1, (4000, 4))
    taxonomy, labels = softmax(2.5 * logits, 1), np.array([rng.choice(4, p=row) for row in softmax(logits, 1)])
    temperature = fit_temperature(taxonomy, labels)
    assert temperature == pytest.approx(2.5, abs=0.15)
    assert (tempered(taxonomy, temperature).argmax(1) == taxonomy.argmax(1)).all()


@pytest.mark.parametrize("right", [True, False])
def test_temperature_of_one_kind_of_answer_is_bounded(right: bool) -> None:
    taxonomy = np.full((9, 4), 0.1, np.float32) + 0.6 * np.eye(4, dtype=np.float32)[0]
    assert TEMPERATURES[0] <= fit_temperature(taxonomy, np.full(9, 0 if right else 1)) <= TEMPERATURES[1]
    assert fit_temperature(np.zeros((0, 4)), np.zeros(0)) == 1


def test_model_answers_with_the_tempered_taxonomy() -> None:
    config, image = ModelConfig(size_px=SIZE), np.zeros((*SIZE, 3), np.uint8)
    model = build(config, 0)
    before = Predictor(model).predict(image, "pour tea").taxonomy
    model.config = replace(config, temperature=3.0)
    after = Predictor(model).predict(image, "pour tea").taxonomy
    assert after == pytest.approx(tempered(before, 3.0), abs=1e-5) and after.max() < before.max()


def test_validation_fits_both_hands_by_their_probability() -> None:
    probability, truth = overconfident(0)
    regions, true = probability[:38_400].reshape(1, 1, 160, 240), truth[:38_400].reshape(160, 240)
    idle, taxonomy = np.zeros_like(true), np.array([0.7, 0.1, 0.1, 0.1])
    found = validation_metrics([ValidationSample(np.concatenate([regions, regions], 1), taxonomy, np.stack([true, idle]), 0)])
    left, right = hand_probabilities(tempered(taxonomy, found["temperature"]))
    assert (found["slope"], found["offset"]) == fit_calibration(
        [(regions.ravel(), true.ravel(), left), (regions.ravel(), idle.ravel(), right)])
