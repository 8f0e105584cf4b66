"""Synthetic reaches: speed and aperture profiles of people, a hold that fits the handle, and retargeting."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.grasping.motion.skeleton import aperture, closings, pose_hand
from afford.grasping.motion.synthetic import minimum_jerk, minimum_jerk_through
from schemas.hand import PHASES, HandMotion
from stages.grasping import hand_retarget, motion_synthesise
from tests.helpers.made_hands import shadow
from tests.helpers.made_motions import HANDLE_ALONG_X, rod

STILL = motion_synthesise.Params(clips=4, noise_m=0.0)
REACH, LIFT = PHASES.index("reach"), PHASES.index("lift")


def made(params: motion_synthesise.Params = STILL, **target: object) -> tuple[HandMotion, ...]:
    return motion_synthesise.run(rod(**target), params)  # type: ignore[arg-type]  # fields of the rod


def test_minimum_jerk_is_minimal() -> None:
    """Any bump that keeps both ends at rest adds squared jerk."""
    s = np.linspace(0, 1, 2001)

    def jerk(path: np.ndarray) -> float:
        return float(np.square(np.diff(path, 3) * 2000**3).mean())

    least = minimum_jerk(s)
    assert jerk(least) == pytest.approx(720, rel=0.01)
    for k in (1, 2, 3):
        assert jerk(least + 0.02 * (s * (1 - s)) ** 3 * np.sin(k * np.pi * s)) > jerk(least)
    assert np.diff(least).max() * 2000 == pytest.approx(15 / 8, rel=1e-4)


def test_minimum_jerk_through_knots() -> None:
    times = np.array([0.0, 1.0, 3.0, 9.0])
    np.testing.assert_array_equal(minimum_jerk_through(times, np.array([0.0, 1.0, 3.0]), np.array([2.0, 5.0, 1.0])), [2, 5, 1, 1])


def test_speed_profile_of_the_reach() -> None:
    """One peak near the middle, 15/8 of the mean; the wrist moves on a straight line."""
    for motion in made():
        reach = motion.keypoints_m[motion.phase == REACH, 0]
        speed = np.linalg.norm(np.diff(reach, axis=0), axis=1)
        peak = int(speed.argmax())
        assert (np.diff(speed[: peak + 1]) > 0).all() and (np.diff(speed[peak:]) < 0).all()
        assert 0.45 < peak / len(speed) < 0.55
        assert speed.max() / speed.mean() == pytest.approx(15 / 8, rel=0.02)
        along = reach[-1] - reach[0]
        off = np.cross(reach - reach[0], along / np.linalg.norm(along))
        assert np.linalg.norm(off, axis=1).max() < 1e-9


def test_aperture_profile() -> None:
    """One peak at 60 to 70 % of the reach; the aperture ends at the size of the handle."""
    for motion in made(diameter_m=0.04):
        wide = aperture(motion.keypoints_m)
        peak, reach = int(wide.argmax()), int((motion.phase == REACH).sum())
        assert 0.58 < peak / reach < 0.72
        assert (np.diff(wide[: peak + 1]) > -1e-9).all() and (np.diff(wide[peak:]) < 1e-9).all()
        assert wide[-1] == pytest.approx(0.04 + 2 * 0.006, abs=5e-4)


def test_peak_aperture_grows_with_the_object() -> None:
    """The slope is 0.82, as long as the hand can open."""
    small, large = (aperture(made(diameter_m=size)[0].keypoints_m).max() for size in (0.02, 0.04))
    assert (large - small) / 0.02 == pytest.approx(0.82, abs=0.02)


@pytest.mark.parametrize("handle", [HANDLE_ALONG_X, np.eye(4)])
def test_hold_of_a_handle(handle: np.ndarray) -> None:
    """The middle of the handle lies between thumb and fingers, which are orthogonal to it."""
    for motion in made(handle=handle):
        held = motion.keypoints_m[motion.phase == PHASES.index("hold")][-1]
        thumb, fingers = held[4], held[[8, 12]].mean(axis=0)
        np.testing.assert_allclose((thumb + fingers) / 2, [0.1, 0.3, 0.05], atol=1e-3)
        assert abs((fingers - thumb) @ handle[:3, 2]) < 1e-3


def test_the_object_is_lifted_with_the_hand() -> None:
    """The object is still until the lift, then rises with the wrist to the requested height."""
    (motion, *_) = made(replace(STILL, lift_m=0.15))
    before = motion.phase != LIFT
    np.testing.assert_array_equal(motion.object_pose[before], np.tile(motion.object_pose[0], (before.sum(), 1)))
    rise = motion.object_pose[~before, 2] - 0.05
    assert rise[-1] == pytest.approx(0.15, abs=1e-4)
    wrist = motion.keypoints_m[~before, 0, 2] - motion.keypoints_m[before][-1, 0, 2]
    np.testing.assert_allclose(wrist, rise, atol=1e-9)


def test_bone_lengths_are_constant() -> None:
    points = pose_hand(np.linspace(0, 1, 30), np.linspace(-1, 1, 30))
    bones = np.linalg.norm(np.diff(points[:, 1:].reshape(30, 5, 4, 3), axis=2), axis=-1)
    np.testing.assert_allclose(bones, np.tile(bones[:1], (30, 1, 1)), atol=1e-12)
    wide, amount = closings(0.0)
    assert (np.diff(wide) >= 0).all() and (np.diff(amount) < 0).all()


def test_seeds_of_clips() -> None:
    """Clips differ; a seed gives the same bytes; fewer clips are the first of more."""
    some, again, other = made(), made(), made(replace(STILL, seed=1))
    assert [m.keypoints_m.tobytes() for m in some] == [m.keypoints_m.tobytes() for m in again]
    assert len({m.keypoints_m.tobytes() for m in (*some, *other)}) == 8
    np.testing.assert_array_equal(made(replace(STILL, clips=2))[1].keypoints_m, some[1].keypoints_m)


@pytest.mark.parametrize("diameter_m", [0.01, 0.05, 0.08])
def test_a_robot_hand_can_follow(diameter_m: float) -> None:
    """Retargeting keeps all clips, tremor included."""
    for motion in made(replace(STILL, noise_m=0.0003, clips=1), diameter_m=diameter_m):
        found = hand_retarget.run(motion, shadow(), hand_retarget.Params())
        assert found.verdict.kept, found.verdict.detail
        assert found.verdict.error_p95_m < 0.01


def test_invalid_handles_and_parameters_are_rejected() -> None:
    with pytest.raises(ValueError, match=r"rod, diameter_m: expected \d+ to \d+ mm, which a hand can span, got 150 mm"):
        made(diameter_m=0.15)
    for name, value in (("clips", 0), ("reach_s", (1.2, 0.8)), ("hooking", (-2.0, 0.0))):
        with pytest.raises(ValueError, match=f"motion_synthesise, {name}: expected"):
            made(replace(STILL, **{name: value}))  # type: ignore[arg-type]  # wrong on purpose
