"""The measures obey the laws that their definitions promise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from afford.common.masks import boundary, boundary_f, precision, psnr_db, recall, region_similarity

MASKS = arrays(bool, (9, 11), elements=st.booleans())


def square(x: int) -> np.ndarray:
    mask = np.zeros((40, 40), bool)
    mask[10:20, x : x + 10] = True
    return mask


@given(MASKS, MASKS)
def test_scores_lie_between_zero_and_one(a: np.ndarray, b: np.ndarray) -> None:
    """Every score is in [0, 1], or NaN exactly when both masks are empty."""
    for score in (region_similarity(a, b), precision(a, b), recall(a, b), boundary_f(a, b)):
        assert math.isnan(score) if not (a.any() or b.any()) else 0 <= score <= 1


@given(MASKS, MASKS)
def test_symmetry(a: np.ndarray, b: np.ndarray) -> None:
    """J and F do not care which mask is the truth."""
    assert np.array_equal([region_similarity(a, b), boundary_f(a, b)], [region_similarity(b, a), boundary_f(b, a)], equal_nan=True)


@given(MASKS)
def test_a_mask_agrees_with_itself(a: np.ndarray) -> None:
    """J, F, precision and recall of a mask with itself are 1."""
    if a.any():
        assert region_similarity(a, a) == boundary_f(a, a) == precision(a, a) == recall(a, a) == 1


def test_known_values() -> None:
    """Two squares shifted by half overlap in a third; the same shift by the tolerance keeps F at 1."""
    assert region_similarity(square(5), square(10)) == pytest.approx(1 / 3)
    assert precision(square(5), square(10)) == 0.5
    assert boundary_f(square(5), square(7), tolerance_px=2) == 1
    assert boundary_f(square(5), square(9), tolerance_px=2) < 1


def test_boundary_is_one_pixel_wide() -> None:
    """The boundary of a 10 x 10 square is its rim of 36 pixels."""
    assert boundary(square(5)).sum() == 36


def test_psnr() -> None:
    """An error of one grey level everywhere is 48.13 dB; only masked pixels count; no pixel gives NaN."""
    a = np.full((4, 4, 3), 100, np.uint8)
    assert psnr_db(a, a + 1) == pytest.approx(48.1308, abs=1e-4)
    mask = np.zeros((4, 4), bool)
    assert math.isnan(psnr_db(a, a + 1, mask))
    mask[0, 0] = True
    b = a.copy()
    b[1:] += 50
    assert psnr_db(a, b, mask) == math.inf
