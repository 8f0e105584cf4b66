"""The short algebra of rotations is scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from afford.common.quaternions import inverse, matrix, product


def test_as_scipy_has_it() -> None:
    """Matrices, products and inverses of random rotations."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        one, two = Rotation.random(rng=rng), Rotation.random(rng=rng)
        assert matrix(one.as_quat()) == pytest.approx(one.as_matrix())
        assert matrix(product(one.as_quat(), two.as_quat())) == pytest.approx((one * two).as_matrix())
        assert matrix(inverse(one.as_quat())) == pytest.approx(one.inv().as_matrix())
