"""Retargeting: accuracy, exact joint limits, mirror symmetry, dropped clips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.grasping.hand.kinematics import forward_kinematics, joint_limits, points_on_links
from afford.grasping.motion.fit import FitState, FitWeights, RetargetProblem
from afford.grasping.motion.keypoints import hand_motion
from afford.grasping.motion.retarget import mirror_motion
from afford.grasping.motion.targets import hand_points, scaled_targets
from schemas.hand import HandModel, HandMotion, HandReference, Retargeted
from stages.grasping import hand_retarget, motion_read, motion_report
from tests.helpers.made_hands import shadow
from tests.helpers.made_motions import SHARED, own_motion, trajectory, tree

PARAMS = hand_retarget.Params()
ANYTHING = {"max_error_m": 1.0, "max_joint_rad_s": 1e4, "max_palm_m_s": 100.0, "max_point_m_s": 100.0, "max_bone_change": 9.0}


@pytest.fixture(scope="module")
def motion() -> HandMotion:
    return own_motion(shadow(), trajectory(shadow(), 60, seed=1))


def run(motion: HandMotion, **changes: object) -> Retargeted:
    return hand_retarget.run(motion, shadow(), replace(PARAMS, **changes))  # type: ignore[arg-type]  # fields of Params


@pytest.fixture(scope="module")
def fitted(motion: HandMotion) -> HandReference:
    (reference,) = run(motion).references
    return reference


@pytest.fixture(scope="module")
def not_centred(motion: HandMotion) -> Retargeted:
    return run(motion, centre=False)


def noisy(seed: int, frames: int = 40) -> HandMotion:
    """Shake all points of a posed hand by centimetres, which no hand can follow."""
    motion = own_motion(shadow(), trajectory(shadow(), frames, seed=seed))
    shake = np.random.default_rng(seed).normal(0, 0.02, motion.keypoints_m.shape)
    return replace(motion, keypoints_m=motion.keypoints_m + shake)


def test_the_hands_own_motion_is_recovered(motion: HandMotion, not_centred: Retargeted) -> None:
    """Points and palm agree within a millimetre, smoothing included."""
    (reference,), found = not_centred.references, not_centred
    assert found.verdict.kept and found.verdict.error_p95_m < 1e-3 and reference.error_m.max() < 1e-3
    theirs = motion.keypoints_m[:, [4, 8, 12, 16, 20]]
    assert np.linalg.norm(reference.tips_m - theirs, axis=-1).max() < 1e-3
    assert reference.bone_error_rad.max() < 0.02


def test_references_agree_with_forward_kinematics(fitted: HandReference) -> None:
    """Forward kinematics of q, gantry included, gives the stored palm, both levels and the tips."""
    hand, reference = shadow(), fitted
    T = forward_kinematics(hand.joints, reference.q)
    np.testing.assert_allclose(T[:, hand.palm], reference.T_world_palm, atol=1e-9)
    nought = np.zeros((len(hand.fingers.name), 3))
    for links, offsets, stored in ((hand.fingers.base_link, nought, reference.level_1_m),
                                   (hand.fingers.middle_link, nought, reference.level_2_m),
                                   (hand.fingers.tip_link, hand.fingers.tip_m, reference.tips_m)):  # fmt: skip
        np.testing.assert_allclose(points_on_links(T, links, offsets), stored, atol=1e-9)


def test_centred_world(fitted: HandReference, not_centred: Retargeted) -> None:
    """`centre` transforms the world by T_world_source: the palm starts at x = y = 0, and its mean yaw is 0."""
    moved, (kept,) = fitted, not_centred.references
    np.testing.assert_allclose(moved.T_world_palm, moved.T_world_source @ kept.T_world_palm, atol=1e-9)
    np.testing.assert_allclose(moved.T_world_palm[0, :2, 3], 0, atol=1e-12)
    np.testing.assert_array_equal(kept.T_world_source, np.eye(4))
    assert abs(np.angle(np.exp(1j * moved.q[:, 3]).mean())) < 0.3


@pytest.mark.parametrize("seed", range(3))
def test_joint_limits_hold_exactly(seed: int) -> None:
    """Limits hold for motion that no hand can do; coupled joints equal their drivers."""
    hand = shadow()
    (reference,) = run(noisy(seed), **ANYTHING).references
    low, high = joint_limits(hand.joints).T
    assert (reference.q >= low).all() and (reference.q <= high).all()
    names = list(hand.joints.name)
    for finger in ("FF", "MF", "RF", "LF"):
        np.testing.assert_array_equal(reference.q[:, names.index(f"{finger}J0")], reference.q[:, names.index(f"{finger}J1")])


def test_gradient_of_the_cost() -> None:
    """The analytic J^T e equals the numerical derivative of the cost by every unknown of a frame."""
    hand = shadow()
    which, motion = hand_points(hand), own_motion(hand, trajectory(hand, 3, seed=5))
    goal = scaled_targets(hand, which, motion.keypoints_m, 0.0)
    problem = RetargetProblem(hand, which, goal, FitWeights(1.0, 0.7, 2.0, 1.5, 0.05, 0.0))
    state = problem.start()
    state = state.moved(np.random.default_rng(0).normal(0, 0.1, (3, problem.size)), problem.low, problem.high)
    _, g = problem.normal(state)
    wide = np.full_like(problem.low, 9.0)
    for k in range(problem.size):
        step = np.zeros((3, problem.size))
        step[:, k] = 1e-6
        cost = [np.square(problem.errors(state.moved(sign * step, -wide, wide))).sum(axis=1) / 2 for sign in (1, -1)]
        np.testing.assert_allclose((cost[0] - cost[1]) / 2e-6, g[:, k], rtol=1e-4, atol=1e-8)


def test_left_clips_are_mirrored(motion: HandMotion) -> None:
    """A mirrored clip gives the same bits; with mirror=False it is dropped."""
    pose = np.tile([0.1, 0.2, 0.3, 0.1, 0.2, 0.3, 0.9], (60, 1))
    motion = replace(motion, object_pose=pose, object_name="cup")
    right, left = run(motion), run(mirror_motion(motion))
    np.testing.assert_array_equal(right.references[0].q, left.references[0].q)
    np.testing.assert_array_equal(right.references[0].object_pose, left.references[0].object_pose)
    assert left.references[0].mirrored and left.verdict.mirrored and not right.references[0].mirrored
    dropped = run(mirror_motion(motion), mirror=False)
    assert (dropped.verdict.reason, dropped.references) == ("other hand", ())


def test_determinism() -> None:
    first, second = run(noisy(3), max_point_m_s=100.0), run(noisy(3), max_point_m_s=100.0)
    assert repr(first.verdict) == repr(second.verdict)
    assert [r.q.tobytes() for r in first.references] == [r.q.tobytes() for r in second.references]


def broken(motion: HandMotion) -> dict[str, HandMotion]:
    """Return reason -> a clip that is dropped for it."""
    jump, stretched, far = (motion.keypoints_m.copy() for _ in range(3))
    jump[30:] += [0.3, 0, 0]
    stretched[::4, 8] += 2 * (stretched[::4, 8] - stretched[::4, 7])
    far += [0, 0, 2.5]
    curled = own_motion(shadow(), trajectory(shadow(), 60, seed=1, share=0.3))
    short = replace(motion, keypoints_m=motion.keypoints_m[:9], phase=motion.phase[:9])
    return {"teleport": replace(motion, keypoints_m=jump), "too short": short, "out of reach": replace(motion, keypoints_m=far),
            "bends backwards": replace(curled, side="left"),
            "bones change": replace(motion, keypoints_m=stretched, rate_hz=1.0),
            "palm speed": replace(motion, keypoints_m=motion.keypoints_m + np.linspace(0, 1, 60)[:, None, None] * [0, 1.5, 0]),
            "joint speed": replace(motion, rate_hz=1000.0)}  # fmt: skip


REASONS = ("teleport", "too short", "out of reach", "bends backwards", "bones change", "palm speed", "joint speed")


@pytest.mark.parametrize("reason", REASONS)
def test_reasons_of_dropped_clips(motion: HandMotion, reason: str) -> None:
    """The verdict names the rule and its figure; no reference remains."""
    looser = {"joint speed": {"min_s": 0.01, "max_point_m_s": 500.0, "max_palm_m_s": 500.0, "max_rate_hz": 1000.0},
              "palm speed": {"max_palm_m_s": 1.0}}
    found = run(broken(motion)[reason], **looser.get(reason, {}))
    assert (found.verdict.reason, found.verdict.kept, found.references) == (reason, False, ())
    assert found.verdict.detail


def test_clips_with_large_errors_are_dropped() -> None:
    found = run(noisy(1), max_point_m_s=100.0, max_bone_change=9.0)
    assert found.verdict.reason == "error too large" and found.verdict.error_p95_m > PARAMS.max_error_m
    assert found.verdict.detail.startswith(f"{1000 * found.verdict.error_p95_m:.1f} mm")


def test_fast_clips_are_subsampled_and_long_ones_cut(motion: HandMotion, fitted: HandReference) -> None:
    """120 Hz becomes 60 Hz: frames 0, 2, 4..."""
    twice = own_motion(shadow(), np.repeat(trajectory(shadow(), 60, seed=1), 2, axis=0), rate_hz=120.0)
    (thin,) = run(twice).references
    assert thin.rate_hz == 60.0
    np.testing.assert_array_equal(thin.q, fitted.q)
    assert len(run(motion, max_frames=40).references[0].q) == 40


def test_pitch_at_a_right_angle() -> None:
    """Yaw and roll of the gantry are one rotation there; the fit still succeeds and q gives the palm."""
    hand, q = shadow(), trajectory(shadow(), 40, seed=2)
    q[:, 3:6] = [0.3, -np.pi / 2, 0.2]
    q[:, 4] += 0.02 * np.sin(np.arange(40) / 6)
    q[:, 4] = np.maximum(q[:, 4], -np.pi / 2)
    found = run(own_motion(hand, q), max_joint_rad_s=100.0)
    assert found.verdict.kept and found.verdict.error_p95_m < 1e-3
    (reference,) = found.references
    np.testing.assert_allclose(forward_kinematics(hand.joints, reference.q)[:, hand.palm], reference.T_world_palm, atol=1e-3)


def test_keep_tips() -> None:
    """A hand with shorter fingers holds an object: with keep_tips its tips are nearer to the human ones."""
    hand = shadow()
    points = own_motion(hand, trajectory(hand, 30, seed=4, share=0.5)).keypoints_m.copy()
    chains = points[:, 1:].reshape(30, 5, 4, 3)
    chains[:, :, 1:] = chains[:, :, :1] + 0.8 * (chains[:, :, 1:] - chains[:, :, :1])
    held = hand_motion("held", "test", "right", 60.0, points, where="test", object_name="cup",
                       object_pose=np.tile([0, 0, 0, 0, 0, 0, 1.0], (30, 1)))  # fmt: skip
    found = [run(held, keep_tips=keep, centre=False, max_error_m=0.05).references[0].tips_m for keep in (0.0, 1.0)]
    far = [np.linalg.norm(tips - chains[:, :, 3], axis=-1).mean() for tips in found]
    assert far[1] < 0.5 * far[0]


def test_acceleration_weight() -> None:
    """A higher weight gives less acceleration and a larger error."""
    shaky = replace(own_motion(shadow(), trajectory(shadow(), 60, seed=1)), rate_hz=60.0)
    shaky = replace(shaky, keypoints_m=shaky.keypoints_m + np.random.default_rng(0).normal(0, 0.002, shaky.keypoints_m.shape))
    found = [run(shaky, **ANYTHING | {"acceleration_m": price}).references[0] for price in (1e-5, 2e-3)]
    shake = [np.abs(np.diff(one.q[:, 6:], 2, axis=0)).mean() for one in found]
    assert shake[1] < 0.3 * shake[0] and found[1].error_m.mean() > found[0].error_m.mean()


def test_a_hand_without_a_gantry(motion: HandMotion, fitted: HandReference) -> None:
    """q contains the fingers only; the palm's pose locates the free root."""
    free: HandModel = shadow(wrist="none")
    (reference,) = hand_retarget.run(motion, free, PARAMS).references
    np.testing.assert_allclose(reference.q, fitted.q[:, 6:], atol=1e-9)
    np.testing.assert_allclose(reference.T_world_palm, fitted.T_world_palm, atol=1e-9)


def test_report_counts_reasons(motion: HandMotion) -> None:
    clips = broken(motion)
    found = [run(replace(clip, name=reason)) for reason, clip in clips.items() if reason in ("teleport", "too short")]
    again = replace(clips["teleport"], name="again")
    everything = motion_report.run((run(motion), *found, run(again)), motion_report.Params("hand"))
    assert everything.report.kept == 1 and everything.report.dropped == ("teleport: 2", "too short: 1")
    assert [verdict.name for verdict in everything.report.verdicts] == ["again", "own", "teleport", "too short"]
    with pytest.raises(ValueError, match="no clip of 2 can be imitated; teleport: 1, too short: 1"):
        motion_report.run(tuple(found), motion_report.Params())


@pytest.mark.parametrize(("name", "value"), [("tips", 0.0), ("max_rate_hz", -1.0), ("min_s", -0.1), ("keep_tips", 1.5)])
def test_parameters_out_of_range(motion: HandMotion, name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"hand_retarget, {name}: expected"):
        run(motion, **{name: value})


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs ../shared/data/motion")
def test_recorded_motion_is_followed() -> None:
    """A webcam clip and real grasps: errors below 10 mm, bones within some degrees."""
    (clip,) = motion_read.run(tree(SHARED / "human_hand_keypoints_right.npz"), motion_read.Params())
    found = run(clip, max_frames=120).verdict
    assert found.kept and found.error_p95_m < 0.01 and found.bone_error_rad < np.deg2rad(14)
    grasps = motion_read.run(tree(SHARED / "dexycb_train_grasps.npz"), motion_read.Params("dexycb"))
    assert all(run(grasp, keep_tips=0.0).verdict.error_mean_m < 0.01 for grasp in grasps[::40])


def test_steps_of_the_palm_are_in_the_world_frame() -> None:
    """A step rotates the palm about world axes and clips motors at their limits."""
    state = FitState(np.eye(4)[None], np.zeros((1, 2)))
    moved = state.moved(np.array([[1, 2, 3, 0, 0, np.pi / 2, 5, -5]]), np.full(2, -1.0), np.full(2, 1.0))
    np.testing.assert_allclose(moved.palm[0], [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-12)
    np.testing.assert_array_equal(moved.motors, [[1, -1]])
