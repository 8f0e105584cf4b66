"""Motion primitives, tracks, curves and the head camera."""

from __future__ import annotations

import numpy as np
import pytest

from afford.render.camera import CALM, PARALLAX, Head, intrinsics, look_at
from afford.render.motion import Curve, Track, approach, arc, axis_angle, blend, ease, log_rotation, pose


def test_ease_is_minimum_jerk():
    """Progress runs from 0 to 1, without speed or acceleration at both ends, and is monotone."""
    s = np.linspace(0, 1, 1001)
    values = np.array([ease(x) for x in s])
    assert values[0] == 0
    assert values[-1] == pytest.approx(1)
    assert (np.diff(values) >= 0).all()
    assert np.abs(np.diff(values)[[0, -1]]).max() < 1e-7


@pytest.mark.parametrize("angle", [0.0, 1e-4, 1.0, 3.0, np.pi])
def test_log_rotation_inverts_about(angle):
    """The rotation vector reproduces its rotation, also for a half turn."""
    rotation = axis_angle((0.3, -0.5, 0.8), angle)
    turn = log_rotation(rotation)
    again = axis_angle(turn, float(np.linalg.norm(turn))) if angle else np.eye(3)
    np.testing.assert_allclose(again, rotation, atol=1e-6)


@pytest.mark.parametrize("path", [arc, approach])
def test_paths_start_and_end_at_their_poses(path):
    """A path begins at its first pose, ends at its last and stays rigid in between."""
    a, b = pose((0, 0, 0)), pose((0.3, 0.1, 0.2), axis_angle((0, 0, 1), 2.0))
    move = path(a, b, np.array([0, 0, 0.1])) if path is arc else path(a, b, np.zeros(3), np.array([0, 0, -0.05]))
    np.testing.assert_allclose(move(0.0), a, atol=1e-9)
    np.testing.assert_allclose(move(1.0), b, atol=1e-9)
    half = move(0.5)[:3, :3]
    np.testing.assert_allclose(half @ half.T, np.eye(3), atol=1e-9)


def test_blend_takes_the_shortest_turn():
    """The rotation half-way between two poses is half the angle."""
    out = blend(pose((0, 0, 0)), pose((1, 0, 0), axis_angle((0, 0, 1), 1.0)), 0.5)
    np.testing.assert_allclose(out, pose((0.5, 0, 0), axis_angle((0, 0, 1), 0.5)), atol=1e-9)


def test_track_refuses_overlapping_segments():
    """Motion segments must not overlap; the error contains the end of the last segment."""
    track = Track(pose((0, 0, 0)), [])
    track.add(0, 10, arc(track.end(), pose((1, 0, 0)), np.zeros(3)))
    with pytest.raises(ValueError, match="after 10"):
        track.add(5, 12, lambda s: pose((0, 0, 0)))


def test_curve_holds_its_value_between_steps():
    """A curve stays at its last value until the next step begins."""
    curve = Curve(np.zeros(1), [])
    curve.add(2, 4, 1.0)
    curve.add(8, 10, 0.5)
    assert [float(curve.at(t)[0]) for t in (0, 2, 4, 7, 10, 20)] == [0, 0, 1, 1, 0.5, 0.5]


def test_look_at_centres_the_target():
    """The target is at the principal point, and up in the world is up in the image."""
    eye, target = np.array([0.1, -0.2, 0.5]), np.array([0.0, 0.3, 0.0])
    local = np.linalg.inv(look_at(eye, target)) @ np.append(target, 1)
    np.testing.assert_allclose(local[:2], 0, atol=1e-12)
    assert (np.linalg.inv(look_at(eye, target)) @ np.append(target + (0, 0, 0.1), 1))[1] < 0
    assert intrinsics(456, 256, 60)[0, 2] == 227.5


def test_parallax_style_moves_the_head_farther():
    """The parallax style moves the head sideways much farther than the calm one."""
    def reach(style):
        head = Head(np.random.default_rng(1), style, np.array([0, -0.2, 0.5]), 121)
        head.look(0, 1, np.array([0, 0.3, 0]))
        return np.ptp([head.at(t)[0, 3] for t in range(0, 121, 5)])

    assert reach(PARALLAX) > 2 * reach(CALM)
