"""End-point error, by hand."""

from __future__ import annotations

import numpy as np

from afford.rgbd.scene_flow.metrics import end_point_error, moving_mask


def test_end_point_error_by_hand() -> None:
    """Three known pixels: one moves and has an error of 3 mm, one of two at rest has an error of 6 mm; the fourth is unknown."""
    truth = np.array([[0.01, 0, 0], [0, 0, 0], [0, 0, 0], [9, 9, 9]])
    found = np.array([[0.01, 0.003, 0], [0, 0, 0.006], [0, 0, 0], [0, 0, 0]])
    error = end_point_error(found, truth, np.array([True, True, True, False]), moving_mask(truth))
    assert np.allclose(error, (0.003, 0.003, 1 / 3))


def test_end_point_error_without_truth_is_nan() -> None:
    """NaN, not 0."""
    assert np.isnan(end_point_error(np.zeros((2, 3)), np.zeros((2, 3)), *np.zeros((2, 2), bool))).all()


def test_motion_on_the_image_by_hand() -> None:
    """Moving pixels are those that move in space, not on the image: a surface may approach without moving in the image."""
    towards = np.array([[0, 0, -0.02], [0, 0, 0]])
    error = end_point_error(np.array([[3.0, 4.0], [0, 1]]), np.zeros((2, 2)), np.ones(2, bool), moving_mask(towards))
    assert np.allclose(error, (3, 5, 1 / 2))
