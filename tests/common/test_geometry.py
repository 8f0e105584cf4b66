"""Quaternions against scipy, surface sampling, and farthest point sampling."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from afford.common.geometry import (
    farthest_point_sampling,
    quaternion_inverse,
    quaternion_matrix,
    quaternion_product,
    sample_surface,
)
from tests.helpers.made_meshes import ball


def test_quaternions_agree_with_scipy() -> None:
    """Check matrices, products and inverses of random rotations."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        one, two = Rotation.random(rng=rng), Rotation.random(rng=rng)
        assert quaternion_matrix(one.as_quat()) == pytest.approx(one.as_matrix())
        assert quaternion_matrix(quaternion_product(one.as_quat(), two.as_quat())) == pytest.approx((one * two).as_matrix())
        assert quaternion_matrix(quaternion_inverse(one.as_quat())) == pytest.approx(one.inv().as_matrix())


def test_points_are_on_their_faces_in_proportion() -> None:
    """Check that counts differ from the share by at most one."""
    made = ball(0.1, 2)
    points, face = sample_surface(made.vertices, made.faces, made.area_faces, 5000, np.random.default_rng(0))
    assert np.abs(((points - made.triangles[face, 0]) * made.face_normals[face]).sum(1)).max() < 1e-6
    share = np.bincount(face, minlength=len(made.faces)) - 5000 * made.area_faces / made.area
    assert np.abs(share).max() < 2


def test_faces_without_weight_get_no_point() -> None:
    """Check faces without weight, and meshes without any."""
    made = ball(0.1, 1)
    weight = np.zeros(len(made.faces))
    assert not len(sample_surface(made.vertices, made.faces, weight, 10, np.random.default_rng(0))[0])
    weight[[3, 7]] = 1, 3
    face = sample_surface(made.vertices, made.faces, weight, 100, np.random.default_rng(0))[1]
    assert set(face) == {3, 7} and (face == 7).sum() == pytest.approx(75, abs=1)


def test_points_depend_on_the_seed() -> None:
    """Check equal and different seeds."""
    made = ball(0.1, 2)
    a, b, c = (sample_surface(made.vertices, made.faces, made.area_faces, 50, np.random.default_rng(s))[0] for s in (1, 1, 2))
    assert np.array_equal(a, b) and not np.array_equal(a, c)


def test_farthest_points_cover_the_rest() -> None:
    """Check distinct points, coverage, and the ends of a line."""
    points = np.random.default_rng(0).normal(size=(800, 3)).astype(np.float32)
    taken = farthest_point_sampling(points, 60)
    apart = np.linalg.norm(points[taken][:, None] - points[taken][None], axis=-1) + 9 * np.eye(60)
    cover = np.linalg.norm(points[:, None] - points[taken][None], axis=-1).min(1).max()
    assert len(set(taken)) == 60 and cover <= apart.min() + 1e-6
    line = np.stack([np.linspace(0, 1, 11)] + [np.zeros(11)] * 2, -1)
    assert set(farthest_point_sampling(line, 2)) == {0, 10} and set(farthest_point_sampling(line, 3)) == {0, 5, 10}


def test_farthest_points_of_small_sets() -> None:
    """Check fewer points than requested, and none."""
    assert sorted(farthest_point_sampling(np.eye(3), 100)) == [0, 1, 2] and not len(farthest_point_sampling(np.zeros((0, 3)), 100))
