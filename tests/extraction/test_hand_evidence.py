"""Evidence of hands: regions of probabilities, their order, features, and the fitted logistic models."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from afford.extraction.hands.calibrate import calibrate, fit_logistic
from afford.extraction.hands.evidence import measure, regions, split_regions

SIZE = (90, 160)


def picture(*blocks: tuple[slice, slice, float]) -> tuple[np.ndarray, np.ndarray]:
    """Probabilities with blocks of a right hand, and a picture in which these blocks are skin-coloured."""
    probabilities, rgb = np.full((*SIZE, 4), 0.02, np.float32), np.full((*SIZE, 3), 90, np.uint8)
    for rows, columns, probability in blocks:
        probabilities[rows, columns, 1] = probability
        rgb[rows, columns] = (206, 158, 132)
    return probabilities, rgb


CERTAIN = slice(30, 90), slice(20, 50), 0.97
DOUBTFUL = slice(30, 90), slice(100, 130), 0.55


def test_regions_are_separate_and_the_most_certain_is_first() -> None:
    """Two blocks give two regions, whose masks are the blocks."""
    found = regions(*picture(DOUBTFUL, CERTAIN))
    assert len(found) == 2 and found[0].probability > found[1].probability
    truth = np.zeros(SIZE, bool)
    truth[CERTAIN[:2]] = True
    assert np.array_equal(found[0].mask, truth) and all(0 <= one.probability <= 1 for one in found)


def test_a_picture_without_probability_has_no_region() -> None:
    """Neither low probabilities nor specks are regions."""
    assert regions(*picture()) == [] and regions(*picture((slice(0, 2), slice(0, 3), 0.9))) == []


def test_a_region_needs_a_certain_pixel() -> None:
    """Probabilities between the limits belong to a region only where one above the higher limit is connected."""
    hand = np.full(SIZE, 0.4, np.float32)
    assert split_regions(hand) == []
    hand[5, 5] = 0.9
    (only,) = split_regions(hand)
    assert only.all()


def test_features_of_a_block_at_the_border() -> None:
    """Solidity, area, share of the outline at the border, and contrast."""
    probabilities, rgb = picture(CERTAIN)
    found = regions(probabilities, rgb)[0].evidence
    assert found.solidity > 0.95 and found.area == pytest.approx(np.log10(60 * 30 / (90 * 160)), abs=1e-6)
    assert 0.1 < found.border < 0.3 and found.contrast > 0.3 and found.edge > 0.7
    inside = picture((slice(20, 60), slice(20, 50), 0.97))
    assert regions(*inside)[0].evidence.border == 0


def test_a_region_that_fills_the_picture_has_finite_features() -> None:
    """Contrast and edge are zero where there is no outside."""
    whole = np.full(SIZE, 0.9, np.float32)
    found = measure(np.ones(SIZE, bool), whole, np.zeros((*SIZE, 3), np.float32))
    assert found.contrast == 0 and found.edge == 0 and found.border == 1


def test_evidence_of_the_clip_shifts_the_probability() -> None:
    """Colour and motion of the clip raise it where they agree, and lower it where they do not."""
    made = picture(DOUBTFUL)
    plain = regions(*made)[0].probability
    for name in ("colour", "motion"):
        up, down = (regions(*made, **{name: np.full(SIZE, sign, np.float32)})[0].probability for sign in (1, -1))
        assert down < plain < up


def test_logistic_fit_recovers_the_model() -> None:
    """Weights and bias of drawn labels."""
    rng = np.random.default_rng(0)
    x = rng.normal(size=(20000, 2))
    y = rng.random(20000) < 1 / (1 + np.exp(-(1.5 * x[:, 0] - 0.5 * x[:, 1] - 1)))
    weights, bias = fit_logistic(x, y, 0)
    assert weights == pytest.approx((1.5, -0.5), abs=0.1) and bias == pytest.approx(-1, abs=0.1)


def test_calibration_lowers_the_certainty_of_an_overconfident_network() -> None:
    """Pixels of log odds 8 are hands in nine of ten cases; never does the scale exceed 1."""
    rng = np.random.default_rng(0)
    sign = rng.random((4, 20, 30)) < 0.5
    truth = np.where(rng.random(sign.shape) < 0.9, sign, ~sign)
    model = Fixed(torch.from_numpy(np.where(sign, 8.0, -8.0)).float())
    found = calibrate(model, [(torch.zeros(4, 3, 20, 30), truth)], 0)
    assert found.scale == pytest.approx(np.log(9) / 8, rel=0.15) and abs(found.bias) < 0.3
    assert calibrate(model, [(torch.zeros(4, 3, 20, 30), sign)], 0).scale == 1


class Fixed(torch.nn.Module):
    """Network with these log odds of a hand."""

    def __init__(self, odds: torch.Tensor) -> None:
        super().__init__()
        self.odds = odds

    def forward(self, pictures: torch.Tensor) -> torch.Tensor:
        return self.odds[:, None].expand(-1, 4, -1, -1)
