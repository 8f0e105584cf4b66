"""Distances are what geometry says, and the grid is near them."""

from __future__ import annotations

import numpy as np
import pytest

from afford.surface.negative.project import distance_field, distance_to_points, interpolate_field
from tests.helpers.made_meshes import ball


def test_the_distance_to_a_point_is_the_norm() -> None:
    """And to nothing it is infinite."""
    spots = np.random.default_rng(0).normal(size=(50, 3))
    assert distance_to_points(np.array([[1.0, 2, 3]]), spots) == pytest.approx(np.linalg.norm(spots - [1, 2, 3], axis=1))
    assert np.isinf(distance_to_points(np.zeros((0, 3)), spots)).all()


def test_the_grid_is_within_its_spacing() -> None:
    """Inside within sqrt(3) spacings, exact at the nodes; far outside not below the distance to the box and 1-Lipschitz enough."""
    made = ball(0.05, 2)
    negative = made.vertices[made.vertices[:, 2] > 0.02]
    grid = distance_field("ball", negative, made.vertices, 0.005, 0.03)
    spots = np.random.default_rng(1).uniform(-0.08, 0.08, (400, 3))
    assert np.abs(interpolate_field(grid, spots) - distance_to_points(negative, spots)).max() < 3**0.5 * 0.005
    nodes = grid.origin + grid.spacing_m * np.array([[0, 0, 0], [3, 5, 7], [10, 2, 9]])
    assert interpolate_field(grid, nodes) == pytest.approx(distance_to_points(negative, nodes), abs=1e-6)
    assert interpolate_field(grid, np.array([[5.0, 0, 0]]))[0] == pytest.approx(4.92, abs=0.01)


def test_where_nothing_is_negative_everything_is_far() -> None:
    """Infinity on the whole grid."""
    made = ball(0.05, 1)
    grid = distance_field("ball", np.zeros((0, 3), np.float32), made.vertices, 0.02, 0.02)
    assert np.isinf(grid.distance_m).all() and np.isinf(interpolate_field(grid, np.zeros((1, 3)))).all()
