"""Masks: bounding boxes, metrics, nearest fill."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from afford.common.masks import boundary, boundary_f, box, fill_nearest, precision, psnr_db, recall, region_similarity


@pytest.mark.parametrize("seed", range(20))
def test_box_is_tight(seed: int) -> None:
    """Check that the mask is inside and touches every side."""
    rng = np.random.default_rng(seed)
    mask = rng.random(rng.integers(1, 30, 2)) < rng.choice([0.01, 0.1, 0.9])
    mask[tuple(rng.integers(0, mask.shape))] = True
    inside = mask[box(mask)]
    assert inside.sum() == mask.sum()
    assert all(side.any() for side in (inside[0], inside[-1], inside[:, 0], inside[:, -1]))


def test_border_is_clipped_to_the_image() -> None:
    """Check one width, and one for each side in the order left, top, right, bottom."""
    mask = np.zeros((20, 30), bool)
    mask[4:9, 10:12] = True
    assert box(mask, 3) == (slice(1, 12), slice(7, 15))
    assert box(mask, (1, 2, 3, 4)) == (slice(2, 13), slice(9, 15))
    assert box(mask, 50) == (slice(0, 20), slice(0, 30))


def test_empty_mask_has_an_empty_box() -> None:
    """Check every border."""
    empty = np.zeros((5, 6), bool)
    assert empty[box(empty)].shape == empty[box(empty, 9)].shape == (0, 0)


MASKS = arrays(bool, (9, 11), elements=st.booleans())


def square(x: int) -> np.ndarray:
    mask = np.zeros((40, 40), bool)
    mask[10:20, x : x + 10] = True
    return mask


@given(MASKS, MASKS)
def test_scores_are_between_zero_and_one(a: np.ndarray, b: np.ndarray) -> None:
    """Check that a score is in [0, 1], or NaN exactly for two empty masks."""
    for score in (region_similarity(a, b), precision(a, b), recall(a, b), boundary_f(a, b)):
        assert math.isnan(score) if not (a.any() or b.any()) else 0 <= score <= 1


@given(MASKS, MASKS)
def test_symmetry(a: np.ndarray, b: np.ndarray) -> None:
    """Check that J and F are symmetric."""
    assert np.array_equal([region_similarity(a, b), boundary_f(a, b)], [region_similarity(b, a), boundary_f(b, a)], equal_nan=True)


@given(MASKS)
def test_mask_agrees_with_itself(a: np.ndarray) -> None:
    """Check that J, F, precision and recall are 1."""
    if a.any():
        assert region_similarity(a, a) == boundary_f(a, a) == precision(a, a) == recall(a, a) == 1


def test_known_values() -> None:
    """Check two squares shifted by half, and by the tolerance."""
    assert region_similarity(square(5), square(10)) == pytest.approx(1 / 3)
    assert precision(square(5), square(10)) == 0.5
    assert boundary_f(square(5), square(7), tolerance_px=2) == 1
    assert boundary_f(square(5), square(9), tolerance_px=2) < 1


def test_boundary_is_one_pixel_wide() -> None:
    """Check the rim of 36 pixels of a 10 x 10 square."""
    assert boundary(square(5)).sum() == 36


def test_psnr() -> None:
    """Check 48.13 dB for an error of one grey level, masked pixels, and NaN without pixels."""
    a = np.full((4, 4, 3), 100, np.uint8)
    assert psnr_db(a, a + 1) == pytest.approx(48.1308, abs=1e-4)
    mask = np.zeros((4, 4), bool)
    assert math.isnan(psnr_db(a, a + 1, mask))
    mask[0, 0] = True
    b = a.copy()
    b[1:] += 50
    assert psnr_db(a, b, mask) == math.inf


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_fill_nearest(dtype: type) -> None:
    image = np.random.default_rng(0).integers(1, 200, (12, 16, 2)).astype(dtype)
    known = np.zeros((12, 16), bool)
    known[3, 4] = known[8, 13] = True
    found = fill_nearest(image, known)
    assert found.dtype == dtype and np.array_equal(found[known], image[known])
    assert (found[:6, :6] == image[3, 4]).all() and (found[7:, 11:] == image[8, 13]).all()
    assert np.array_equal(fill_nearest(image, np.ones((12, 16), bool)), image)
