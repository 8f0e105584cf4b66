"""Laws of the scores of detected hands, and of the keypoints of rendered hands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from afford.render.camera import intrinsics
from afford.render.scene import Camera
from afford.synthetic.human_hand.appearance import random_person
from afford.synthetic.human_hand.hand_model import HandModel
from afford.synthetic.human_hand.skeleton import posture
from benchmarks.hands.clip_truth import ClipTruth
from benchmarks.hands.keypoints import in_camera, world_keypoints
from benchmarks.hands.scoring import Found, Score, score_clip

SHAPE = (90, 160)


def square(x: int, y: int, side: int = 30) -> np.ndarray:
    out = np.zeros(SHAPE, bool)
    out[y : y + side, x : x + side] = True
    return out


def truth() -> ClipTruth:
    """Left hand at (10, 10) that touches a thing at (10, 45); right hand at (100, 10) that touches nothing; one frame."""
    none = np.zeros(SHAPE, bool)
    hands, touched = np.stack([square(10, 10), square(100, 10)])[:, None], np.stack([square(10, 45), none])[:, None]
    points = np.stack([np.linspace([10, 10], [40, 40], 21), np.linspace([100, 10], [130, 40], 21)])[:, None].astype(np.float32)
    metres = np.concatenate([points / 100, np.ones((2, 1, 21, 1), np.float32)], axis=-1)
    yes = np.ones((2, 1), bool)
    return ClipTruth("x", "ego", np.array([1]), hands, touched, np.array([[True], [False]]), points, metres, yes,
                     np.zeros_like(hands), yes)  # fmt: skip


def perfect(x: ClipTruth) -> list[Found]:
    return [Found(x.hands[n, 0], side, bool(x.contact[n, 0]), x.touched[n, 0], x.keypoints_px[n, 0], x.keypoints_m[n, 0])
            for n, side in enumerate(("left", "right"))]  # fmt: skip


def test_perfect_detections_have_perfect_scores() -> None:
    x = truth()
    got = score_clip(x, {1: perfect(x)})
    assert (got.recall, got.precision, got.sided, got.contacts_right, got.things_found, got.things) == (1, 1, 2, 2, 1, 1)
    assert max(got.keypoint_error) < 1e-6 and max(got.depth_error) < 1e-6


def test_no_detection_finds_nothing_and_claims_nothing() -> None:
    got = score_clip(truth(), {})
    assert (got.annotated, got.found, got.claimed) == (2, 0, 0)


def test_two_detections_of_one_hand_are_one_right_and_one_false() -> None:
    x = truth()
    one = perfect(x)[0]
    got = score_clip(x, {1: [one, replace(one, mask=square(12, 12))]})
    assert (got.found, got.claimed, got.true_claims) == (1, 2, 1)


def test_swapped_sides_are_found_hands_with_wrong_sides() -> None:
    x = truth()
    swapped = [replace(one, side={"left": "right", "right": "left"}[one.side]) for one in perfect(x)]
    got = score_clip(x, {1: swapped})
    assert (got.found, got.side_claims, got.sided) == (2, 2, 0)


def test_masks_of_another_size_score_alike() -> None:
    x = truth()
    small = [replace(one, mask=one.mask[::2, ::2], thing=None, keypoints_px=None) for one in perfect(x)]
    assert score_clip(x, {1: small}).found == 2


def test_scores_add_up() -> None:
    x = truth()
    one = score_clip(x, {1: perfect(x)})
    assert (one + one).annotated == 4 and len((one + one).keypoint_error) == 4 and (Score() + one).found == one.found


def test_truth_survives_its_file(tmp_path: Path) -> None:
    x = truth()
    x.save(tmp_path)
    back = ClipTruth.load(tmp_path)
    assert all(np.array_equal(getattr(x, name), getattr(back, name)) for name in vars(x) if name not in ("name", "viewpoint"))


def test_keypoints_lie_in_the_skin_and_mirror() -> None:
    look = random_person(np.random.default_rng(1))
    T, elbow = np.eye(4), np.array([-0.4, 0.0, -0.1])
    for kind in ("open", "fist"):
        right = world_keypoints(HandModel.build("right", look), T, posture(kind))
        left = world_keypoints(HandModel.build("left", look), T, posture(kind))
        assert np.allclose(left, right * [1, -1, 1])
        skin = HandModel.build("right", look).posed(T, posture(kind), elbow)
        gap = np.linalg.norm(skin[None] - right[:, None], axis=2).min(1)
        assert gap.max() < 0.03


def test_a_point_on_the_optical_axis_projects_to_the_centre() -> None:
    camera = Camera(intrinsics(101, 51, 60.0), np.eye(4), 101, 51)
    pixels, metres = in_camera(np.array([[0.0, 0.0, 2.0]]), camera)
    assert np.allclose(pixels, [[50, 25]]) and np.allclose(metres, [[0, 0, 2]])
