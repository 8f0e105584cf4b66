"""Measures by hand computation: strict ones, those of the released script, several modes, calibration, intervals."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.distance import directed_hausdorff

from afford.common import statistics
from afford.twohands.benchmark import compat, measures
from tests.helpers.made_cases import box

MASKS = arrays(bool, (9, 11), elements=st.booleans())


def grey(mask: np.ndarray) -> np.ndarray:
    return np.where(mask, np.uint8(255), np.uint8(0))


def test_overlap_by_hand() -> None:
    """Two 20 x 20 squares shifted by 10: 200 shared, 600 in the union."""
    assert measures.overlap(box(10, 10, 30, 30), box(20, 10, 40, 30)) == pytest.approx((200 / 600, 0.5, 0.5, 0.5))
    assert measures.overlap(box(10, 10, 20, 20), box(10, 10, 30, 30)) == pytest.approx((0.25, 1.0, 0.25, 0.4))


def test_an_empty_prediction_scores_zero_and_the_diagonal() -> None:
    """Strict measures are 0, and the distance is sqrt(855^2 + 855^2) px."""
    none, truth = np.zeros((855, 855), bool), box(1, 1, 9, 9, (855, 855))
    assert measures.overlap(none, truth) == (0, 0, 0, 0) and measures.precision(none, truth) == 0
    assert measures.hausdorff(none, truth) == pytest.approx((1209.15, 1209.15), abs=0.01)


def test_hausdorff_by_hand() -> None:
    """Inside the truth the directed distance is 0; what sticks out counts; the second piece counts too."""
    truth = box(10, 10, 30, 30)
    assert measures.hausdorff(box(12, 12, 20, 20), truth) == pytest.approx((0, math.hypot(10, 10)))
    assert measures.hausdorff(box(10, 10, 35, 30), truth).directed == 5
    far = box(12, 12, 20, 20) | box(70, 12, 71, 13)
    assert measures.hausdorff(far, truth).directed == 70 - 29


@settings(max_examples=60, deadline=None)
@given(MASKS, MASKS)
def test_hausdorff_is_that_of_all_pixels(found: np.ndarray, truth: np.ndarray) -> None:
    """Equal to scipy over the pixels of both masks."""
    if found.any() and truth.any():
        mine, theirs = np.argwhere(found), np.argwhere(truth)
        there, back = directed_hausdorff(mine, theirs)[0], directed_hausdorff(theirs, mine)[0]
        assert measures.hausdorff(found, truth) == pytest.approx((there, max(there, back)), abs=1e-5)


def test_compat_oracle_of_an_empty_file() -> None:
    """Prediction empty but its file there: IoU 0, precision 0, distance 1209.15 px (855 x 855)."""
    truth = box(1, 1, 9, 9, (855, 855))
    score = compat.case_score((truth,), (np.zeros((256, 256), np.uint8), None))
    assert score == pytest.approx((0, 0, 1209.15, 1209.15), abs=0.01)


def test_compat_skips_what_the_script_skips() -> None:
    """No predicted file, or no true one: not counted."""
    assert compat.case_score((box(1, 1, 9, 9),), (None, None)) is None
    assert compat.case_score((), (grey(box(1, 1, 9, 9)), None)) is None


def test_compat_takes_the_union_of_the_hands() -> None:
    """A hand in the other's place costs nothing."""
    left, right = box(10, 10, 30, 30), box(50, 20, 70, 40)
    assert compat.case_score((left, right), (grey(right), grey(left))) == pytest.approx((1, 1, 0, 0))


def test_compat_reads_resized_masks_as_more_than_zero() -> None:
    """Bilinear doubling of a 4 x 4 square grows it by a pixel on each side: 100 px instead of 64."""
    truth = box(20, 20, 28, 28)
    score = compat.case_score((truth,), (grey(box(10, 10, 14, 14, (30, 40))), None))
    assert score is not None and (score.iou, score.precision) == pytest.approx((64 / 100, 64 / 100))


def test_compat_measures_the_first_contour_alone() -> None:
    """OpenCV lists the lowest piece first; the one far away above it does not count, in strict it does."""
    truth = box(10, 40, 30, 55)
    two = truth | box(70, 2, 75, 7)
    score = compat.case_score((truth,), (grey(two), None))
    assert score is not None and score.hd_px == 0 and measures.hausdorff(two, truth).directed > 40


def reference(truth: np.ndarray, found: np.ndarray) -> tuple[float, float]:
    """Directed and symmetric distance between the corners of first outer contours, written a second time."""
    a, b = (cv2.findContours(m.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0] for m in (found, truth))
    if not a or not b:
        return (math.hypot(*found.shape),) * 2 if not a else (0.0, 0.0)
    gaps = np.linalg.norm(a[0].reshape(-1, 1, 2) - b[0].reshape(1, -1, 2), axis=2)
    return float(gaps.min(axis=1).max()), float(max(gaps.min(axis=1).max(), gaps.min(axis=0).max()))


@settings(max_examples=60, deadline=None)
@given(MASKS, MASKS)
def test_compat_equals_a_second_writing(truth: np.ndarray, found: np.ndarray) -> None:
    """IoU, precision and distances for any two masks, empty ones included."""
    score = compat.case_score((truth,), (None, grey(found)))
    union, mine, both = (truth | found).sum(), found.sum(), (truth & found).sum()
    expected = (both / union if union else 0, both / mine if mine else 0, *reference(truth, found))
    assert score == pytest.approx(expected)


def test_compat_map_is_the_mean_precision_and_the_rest_is_of_the_most_precise_threshold() -> None:
    """Two cases at two thresholds; the second case is skipped at the second threshold."""
    scores = np.array([[[0.5, 0.4, 10, 20], [0.2, 0.9, 5, 6]], [[0.3, 0.6, 30, 40], [np.nan] * 4]])
    found = compat.summary(scores, (0.1, 0.5))
    assert found == pytest.approx((0.2, 0.9, 5, 6, (0.5 + 0.9) / 2, 0.5, 1))
    assert compat.summary(np.full((2, 1, 4), np.nan), (0.5,)) is None


def test_modes_by_hand() -> None:
    """Two modes, two hypotheses; the second hypothesis is a half of the second mode."""
    left, right = box(10, 10, 30, 30), box(50, 20, 70, 40)
    none = np.zeros_like(left)
    truth = np.stack([np.stack([left, none]), np.stack([none, right])])
    said = np.stack([np.stack([left, none]), np.stack([none, box(50, 20, 70, 30)])])
    table = measures.agreement(said, truth)
    assert table.tolist() == [[1, 0], [0, 0.5]]
    assert measures.best_mode_iou(table) == 0.75 and measures.best_hypothesis_iou(table) == 1
    assert measures.best_mode(right, truth) == 1


def test_one_hypothesis_cannot_cover_two_modes() -> None:
    """K = 1 is at best right for one of two disjoint modes."""
    assert measures.best_mode_iou(np.array([[1.0, 0.0]])) == 0.5


def test_calibration_by_hand() -> None:
    """100 pixels of probability 0.8 (204/255) of which 60 are true: the error is 0.2; pixels below the floor do not count."""
    probability = np.full((10, 20), 0.01, np.float32)
    probability[:, :10] = 0.8
    truth = np.zeros((10, 20), np.uint8)
    truth[:6, :10] = 1
    table = measures.reliability(probability, truth, 1, 0.05)
    assert table.sum(axis=1) == pytest.approx([100, 80, 60]) and measures.expected_error(table) == pytest.approx(0.2)


def test_calibration_knows_several_ways() -> None:
    """A pixel that one of two valid ways holds is right at 0.5."""
    table = measures.reliability(np.full((4, 4), 128 / 255, np.float32), np.ones((4, 4), np.uint8), 2, 0.05)
    assert measures.expected_error(table) == pytest.approx(0.5 / 255, abs=1e-6)
    assert math.isnan(measures.expected_error(np.zeros((3, measures.BINS))))


def test_intervals_are_seeded_and_hold_the_mean() -> None:
    """Same seed, same ends; a constant has none; NaN is left out; a column of NaN stays NaN."""
    rng = np.random.default_rng(1)
    half = np.where(np.arange(400) < 200, np.nan, 1.0)
    values = np.stack([rng.normal(5, 1, 400), np.full(400, 2.0), half, np.full(400, np.nan)], axis=1)
    low, high = statistics.bootstrap_interval(values, 500, seed=3)
    assert np.array_equal((low, high), statistics.bootstrap_interval(values, 500, seed=3), equal_nan=True)
    assert not np.array_equal(low[0], statistics.bootstrap_interval(values, 500, seed=4)[0][0])
    assert low[0] < values[:, 0].mean() < high[0] and high[0] - low[0] == pytest.approx(2 * 1.96 / 20, rel=0.2)
    assert (low[1], high[1], low[2], high[2]) == (2, 2, 1, 1) and np.isnan(low[3])
