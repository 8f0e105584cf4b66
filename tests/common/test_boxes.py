"""The box of a mask."""

from __future__ import annotations

import numpy as np
import pytest

from afford.common.masks import box


@pytest.mark.parametrize("seed", range(20))
def test_box_is_the_smallest_around_the_mask(seed: int) -> None:
    """The mask lies inside, and every side of the box touches it."""
    rng = np.random.default_rng(seed)
    mask = rng.random(rng.integers(1, 30, 2)) < rng.choice([0.01, 0.1, 0.9])
    mask[tuple(rng.integers(0, mask.shape))] = True
    inside = mask[box(mask)]
    assert inside.sum() == mask.sum()
    assert all(side.any() for side in (inside[0], inside[-1], inside[:, 0], inside[:, -1]))


def test_a_border_widens_the_box_as_far_as_the_image_goes() -> None:
    """The border is one width, or one for each side in the order left, top, right, bottom."""
    mask = np.zeros((20, 30), bool)
    mask[4:9, 10:12] = True
    assert box(mask, 3) == (slice(1, 12), slice(7, 15))
    assert box(mask, (1, 2, 3, 4)) == (slice(2, 13), slice(9, 15))
    assert box(mask, 50) == (slice(0, 20), slice(0, 30))


def test_an_empty_mask_has_an_empty_box() -> None:
    """Whatever the border."""
    empty = np.zeros((5, 6), bool)
    assert empty[box(empty)].shape == empty[box(empty, 9)].shape == (0, 0)
