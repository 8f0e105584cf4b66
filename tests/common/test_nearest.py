"""Laws of filling: what is known stays, all else is like a nearest known pixel, whatever the type."""

from __future__ import annotations

import numpy as np
import pytest

from afford.common.masks import fill_nearest


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_unknown_pixels_take_the_nearest_known_value(dtype: type) -> None:
    image = np.random.default_rng(0).integers(1, 200, (12, 16, 2)).astype(dtype)
    known = np.zeros((12, 16), bool)
    known[3, 4] = known[8, 13] = True
    found = fill_nearest(image, known)
    assert found.dtype == dtype and np.array_equal(found[known], image[known])
    assert (found[:6, :6] == image[3, 4]).all() and (found[7:, 11:] == image[8, 13]).all()
    assert np.array_equal(fill_nearest(image, np.ones((12, 16), bool)), image)
