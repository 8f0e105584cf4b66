"""Metric hand keypoints: exact on projections, equivariant, within the depth error that noise of a landmark model allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from afford.extraction.hands.hand_fit import BONES, CHAINS
from afford.extraction.hands.metric import (
    PALM,
    Lifting,
    camera_matrix,
    focal_px,
    lift,
    smooth,
)
from afford.grasping.motion.skeleton import pose_hand
from afford.synthetic.human_hand.skeleton import POSTURES, WRIST, bone_frames, tips

PLAIN = Lifting(acceleration_m_s2=0)
WIDTH, HEIGHT = 1280, 720
K = camera_matrix(WIDTH, HEIGHT, focal_px(WIDTH, HEIGHT, 70))
MIRROR = np.array([-1.0, 1, 1])


def rendered_hand(kind: str) -> np.ndarray:
    """Keypoints (21, 3) of the rendered right hand in a posture, palm frame, metres."""
    angles = np.array(POSTURES[kind])
    joints = bone_frames(angles)[2:, :3, 3].reshape(5, 3, 3)
    return np.concatenate([WRIST[None], np.concatenate([joints, tips(angles)[:, None]], axis=1).reshape(20, 3)])


CLOSING = {"open": 0.1, "relaxed": 0.3, "flat": 0.0, "point": 0.6, "fist": 1.0}


def assumed_hand(kind: str, hand_m: float = 0.19) -> np.ndarray:
    """A posture of the skeleton whose proportions are those of the assumed hand, wrist at the origin."""
    return pose_hand(np.array([CLOSING[kind]]), np.zeros(1), hand_m)[0]


def rotation(rng: np.random.Generator) -> np.ndarray:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else q[:, ::-1]


def facing_axes(points: np.ndarray) -> np.ndarray:
    """Return the rotation (3, 3) from the camera to one that faces the points (21, 3) with the same up direction, minimal."""
    rays = points[:, :2] / points[:, 2:]
    ahead = np.append(rays.mean(axis=0), 1)
    ahead /= np.linalg.norm(ahead)
    axis = np.cross([0, 0, 1], ahead)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.asarray((np.eye(3) + cross + cross @ cross / (1 + ahead[2])).T)


def project(points: np.ndarray) -> np.ndarray:
    seen = points @ K.T
    return seen[..., :2] / seen[..., 2:]


def views(count: int, seed: int, hand=assumed_hand) -> tuple[np.ndarray, np.ndarray]:
    """Hands (n, 21, 3) in the camera frame, and the model's keypoints: axes of a camera that faces the hand, any size."""
    rng, kinds = np.random.default_rng(seed), list(POSTURES)
    out, model = [], []
    for n in range(count):
        z = rng.uniform(0.3, 0.9)
        at = np.array([rng.uniform(-0.5, 0.5) * z, rng.uniform(-0.3, 0.3) * z, z])
        points = hand(kinds[n % len(kinds)]) @ rotation(rng).T + at
        out.append(points)
        model.append((points - points.mean(axis=0)) @ facing_axes(points).T * rng.uniform(0.7, 1.3))
    return np.array(out), np.array(model)


def test_exact_projections_are_recovered():
    truth, model = views(40, 1)
    found = lift(project(truth), model, np.ones(40), np.arange(40.0), K, PLAIN)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, truth, atol=1e-3)  # proportions are rounded to a thousandth of the hand


def test_distances_scale_with_the_assumed_hand():
    truth, model = views(10, 2)
    args = project(truth), model, np.ones(10), np.arange(10) / 10, K
    small, large = lift(*args, Lifting()), lift(*args, replace(Lifting(), hand_m=0.38, acceleration_m_s2=4.0, noise_pose_m=0.03))
    np.testing.assert_allclose(large, 2 * small, rtol=1e-4, atol=1e-5)


def test_mirrored_image_gives_the_mirrored_hand():
    truth, model = views(10, 3)
    px = project(truth) + np.random.default_rng(3).normal(0, 3, (10, 21, 2))
    flipped = np.stack([WIDTH - 1 - px[..., 0], px[..., 1]], axis=-1)
    ones, time_s = np.ones(10), np.arange(10) / 10
    np.testing.assert_allclose(lift(flipped, model * MIRROR, ones, time_s, K, Lifting()),
                               lift(px, model, ones, time_s, K, Lifting()) * MIRROR, atol=1e-5)


def test_a_wrong_keypoint_moves_the_hand_little():
    truth, model = views(30, 4)
    px = project(truth)
    px[:, 8] += 150
    found = lift(px, model, np.ones(30), np.arange(30.0), K, PLAIN)
    wrong = np.linalg.norm(found[:, PALM, :].mean(axis=1) - truth[:, PALM, :].mean(axis=1), axis=1)
    assert np.median(wrong) < 0.03
    sure = np.ones((30, 21))
    sure[:, 8] = 0
    np.testing.assert_allclose(lift(px, model, sure, np.arange(30.0), K, PLAIN)[:, 0], truth[:, 0], atol=4e-3)


def test_palm_depth_of_rendered_hands_with_noise():
    truth, model = views(300, 5, lambda kind: rendered_hand(kind) * (0.19 / 0.195))
    rng = np.random.default_rng(5)
    size = np.linalg.norm(np.ptp(project(truth), axis=1), axis=1)[:, None, None]
    px = project(truth) + (rng.normal(0, 0.015, (300, 21, 2)) + rng.normal(0, 0.04, (300, 1, 2))) * size
    model = model + rng.normal(0, 0.008, model.shape)
    found = lift(px, model, np.ones(300), np.arange(300.0), K, PLAIN)
    share = found[:, PALM, 2].mean(axis=1) / truth[:, PALM, 2].mean(axis=1) - 1
    assert np.median(np.abs(share)) < 0.12


def test_bones_keep_their_lengths_and_empty_frames_are_zero():
    truth, model = views(12, 6)
    sure = np.ones(12)
    sure[[0, 5, 6]] = 0
    found = lift(project(truth), model, sure, np.arange(12) / 10, K, Lifting())
    assert not found[[0, 5, 6]].any()
    bones = np.linalg.norm(np.diff(found[sure > 0][:, CHAINS], axis=-2), axis=-1)
    np.testing.assert_allclose(bones, np.broadcast_to(0.19 * BONES, (9, 5, 4)), atol=1e-5)
    assert not lift(project(truth), model, np.zeros(12), np.arange(12) / 10, K, Lifting()).any()


def test_smoothing_lowers_noise_and_does_not_cross_gaps():
    rng, time_s = np.random.default_rng(7), np.arange(60) / 15
    shape = assumed_hand("relaxed")[:, [0, 2, 1]] * [1, -1, 1]
    way = np.stack([0.15 * np.sin(time_s), 0.05 * np.cos(time_s), 0.5 + 0.05 * np.sin(0.7 * time_s)], axis=-1)
    truth = shape + way[:, None]
    model = np.array([points @ facing_axes(points).T for points in truth])
    px, model = project(truth) + rng.normal(0, 6, (60, 21, 2)), model + rng.normal(0, 0.008, model.shape)
    rough, fine = (lift(px, model, np.ones(60), time_s, K, one) for one in (PLAIN, Lifting()))
    error = [float(np.linalg.norm(found - truth, axis=-1).mean()) for found in (rough, fine)]
    jitter = [float(np.linalg.norm(np.diff(found, 2, axis=0), axis=-1).mean()) for found in (rough, fine)]
    assert error[1] < 0.9 * error[0] and jitter[1] < 0.25 * jitter[0]
    broken = time_s + np.where(np.arange(60) >= 30, 5.0, 0.0)
    first = lift(px[:30], model[:30], np.ones(30), time_s[:30], K, Lifting())
    np.testing.assert_array_equal(lift(px, model, np.ones(60), broken, K, Lifting())[:30], first)


def test_smoother_keeps_constant_velocity_and_interpolates():
    time_s = np.array([0.0, 0.1, 0.15, 0.4, 0.5, 0.9])
    line = np.stack([2 - 3 * time_s, 0 * time_s + 1], axis=-1)
    np.testing.assert_allclose(smooth(line, time_s, np.full((6, 2), 0.1), np.full(2, 5.0)), line, atol=1e-3)
    sharp = line.copy()
    sharp[2] += 4
    noise = np.full((6, 2), 1e-4)
    noise[2] = 1e3
    np.testing.assert_allclose(smooth(sharp, time_s, noise, np.full(2, 5.0)), line, atol=1e-2)


def test_focal_length_uses_the_longer_side():
    assert focal_px(1280, 720, 90) == pytest.approx(640)
    assert focal_px(720, 1280, 90) == pytest.approx(640)
    with pytest.raises(ValueError, match="fov_deg"):
        focal_px(1280, 720, 5)
