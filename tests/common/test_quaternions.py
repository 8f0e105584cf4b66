"""The short algebra of rotations is scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from afford.common.geometry import quaternion_inverse, quaternion_matrix, quaternion_product


def test_quaternions_equal_those_of_scipy() -> None:
    """Matrices, products and inverses of random rotations."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        one, two = Rotation.random(rng=rng), Rotation.random(rng=rng)
        assert quaternion_matrix(one.as_quat()) == pytest.approx(one.as_matrix())
        assert quaternion_matrix(quaternion_product(one.as_quat(), two.as_quat())) == pytest.approx((one * two).as_matrix())
        assert quaternion_matrix(quaternion_inverse(one.as_quat())) == pytest.approx(one.inv().as_matrix())
