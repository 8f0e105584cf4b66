"""Grasp candidates from masks and depth: pose, width, negative points, mirror symmetry, pairs of hands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from afford.grasping.candidates.find import APART_M, SAFE_M
from afford.grasping.candidates.point_cloud import unproject
from schemas.grasp import TERMS, GraspCandidates, GraspScene, HandCandidates
from stages.grasping import grasp_candidates
from tests.helpers.made_looks import RADIUS_M, nothing, rod

PARAMS = grasp_candidates.Params(places=24)


def near_end(place: np.ndarray) -> np.ndarray:
    return (place[..., 0] > -0.1) & (place[..., 0] < 0.0)


def far_end(place: np.ndarray) -> np.ndarray:
    return place[..., 0] > 0.03


def everything(place: np.ndarray) -> np.ndarray:
    return np.ones(place.shape[:-1], bool)


def right(scene: GraspScene) -> HandCandidates:
    return grasp_candidates.run(scene, PARAMS).hands[1]


@pytest.fixture(scope="module")
def scene() -> GraspScene:
    """A rod whose near end is for the right hand."""
    return rod(right=near_end)[0]


@pytest.fixture(scope="module")
def found(scene: GraspScene) -> GraspCandidates:
    return grasp_candidates.run(scene, PARAMS)


def in_world(T: np.ndarray, found: HandCandidates) -> np.ndarray:
    out: np.ndarray = T @ found.T_cam_grasp
    return out


@pytest.mark.parametrize(("yaw", "noise_m"), [(0.0, 0.0), (0.7, 0.0), (0.4, 0.0015)])
def test_a_rod_is_grasped_across_its_length(yaw: float, noise_m: float) -> None:
    """The best grasp lies on the axis of the rod to 7 mm (two pixels), thumb along it, from above; its width is the rod's."""
    scene, T = rod(right=near_end, yaw_rad=yaw, noise_m=noise_m)
    found = right(scene)
    best = in_world(T, found)[0]
    along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    aside = best[:3, 3] - [0, 0, RADIUS_M] - along * (best[:3, 3] @ along)
    assert np.linalg.norm(aside) < 0.007
    assert abs(best[:3, 0] @ along) > np.cos(np.radians(12)) and best[2, 1] > np.cos(np.radians(12))
    assert found.width_m[0] == pytest.approx(2 * RADIUS_M, abs=0.008)
    assert -0.1 < best[:3, 3] @ along < 0.0


def test_candidates_are_frames_on_the_cloud_best_first(scene: GraspScene, found: GraspCandidates) -> None:
    """Rotations, fingers orthogonal to the approach, places within a width of a visible point."""
    hand = found.hands[1]
    R = hand.T_cam_grasp[:, :3, :3]
    assert len(hand.score) > 1 and (np.diff(hand.score) <= 0).all() and (hand.score > 0).all()
    assert np.allclose(R @ R.swapaxes(1, 2), np.eye(3)) and np.allclose(np.linalg.det(R), 1.0)
    assert np.allclose(hand.approach, -R[:, :, 1]) and np.allclose((hand.approach * R[:, :, 2]).sum(1), 0.0)
    seen = unproject(scene.depth_m, scene.K)[scene.region[1]]
    off = np.linalg.norm(hand.T_cam_grasp[:, None, :3, 3] - seen[None], axis=2).min(1)
    assert (off <= hand.width_m).all()


@pytest.fixture(scope="module")
def negative() -> GraspScene:
    """A rod that any hand may hold, but not at its far end."""
    return rod(right=everything, negative=far_end)[0]


@pytest.fixture(scope="module")
def avoiding(negative: GraspScene) -> HandCandidates:
    return right(negative)


def test_fingertips_avoid_negative_points(negative: GraspScene, avoiding: HandCandidates) -> None:
    """No fingertip is within 2 cm of a negative far end; without it, some are, so the test can fail."""
    points = unproject(negative.depth_m, negative.K)[negative.negative]

    def least(hand: HandCandidates) -> float:
        return float(np.linalg.norm(hand.tips[:, :, None] - points, axis=3).min())

    assert least(avoiding) > SAFE_M - 0.004  # voxels are 4 mm wide
    assert least(right(replace(negative, negative=np.zeros_like(negative.negative)))) < SAFE_M


def test_negative_points_equal_a_negative_mask(negative: GraspScene, avoiding: HandCandidates) -> None:
    """N_t in the camera frame has the effect of a mask of those points."""
    points = unproject(negative.depth_m, negative.K)[negative.negative]
    a, b = avoiding, right(replace(negative, negative=np.zeros_like(negative.negative), N_t=points))
    assert np.linalg.norm(a.T_cam_grasp[0, :3, 3] - b.T_cam_grasp[0, :3, 3]) < 0.01


def test_the_thumb_points_to_the_negative_end() -> None:
    """Three fingers reach farther along the object than the thumb, so they point away from the negative end."""
    scene, T = rod(right=lambda place: (place[..., 0] < 0.0) & (place[..., 0] > -0.06), negative=lambda place: place[..., 0] > 0.0)
    assert in_world(T, right(scene))[0, 0, 0] > 0.9


def test_a_mirrored_scene_gives_mirrored_grasps() -> None:
    """The left hand in the mirror equals the right hand: same scores, mirrored places and fingertips."""
    scene, _ = rod(right=near_end, yaw_rad=0.4)
    flipped = replace(scene, depth_m=scene.depth_m[:, ::-1].copy(), region=scene.region[::-1, :, ::-1].copy(),
                      hands=scene.hands[::-1].copy(), negative=scene.negative[:, ::-1].copy())  # fmt: skip
    a, b = right(scene), grasp_candidates.run(flipped, PARAMS).hands[0]
    M = np.diag([-1.0, 1.0, 1.0])
    assert np.allclose(a.score, b.score, atol=1e-6)
    assert np.allclose(a.T_cam_grasp[:, :3, 3] @ M, b.T_cam_grasp[:, :3, 3], atol=1e-6)
    assert np.allclose(M @ a.T_cam_grasp[:, :3, :3] @ M, b.T_cam_grasp[:, :3, :3], atol=1e-6)
    assert np.allclose(a.tips @ M, b.tips, atol=1e-6)


def test_two_hands_are_paired_at_a_distance() -> None:
    scene, _ = rod(left=near_end, right=far_end)
    found = grasp_candidates.run(scene, PARAMS)
    left, other = found.hands
    assert len(left.score) and len(other.score) and len(found.pair)
    a, b = (hand.T_cam_grasp[row, :3, 3] for hand, row in zip(found.hands, found.pair.T, strict=True))
    assert (np.linalg.norm(a - b, axis=1) > APART_M).all() and (np.diff(found.pair_score) <= 0).all()


def test_an_unused_hand_gets_no_candidates(found: GraspCandidates) -> None:
    assert not len(found.hands[0].score) and not len(found.pair)


def test_an_object_without_a_table_is_grasped() -> None:
    scene, _ = rod(right=near_end, table=False)
    found = grasp_candidates.run(scene, PARAMS)
    assert not found.up.any() and found.hands[1].score[0] > 0.3


def test_the_best_candidate_is_positive(found: GraspCandidates) -> None:
    """The material between the fingers is positive, and all terms are in 0..1."""
    terms = found.hands[1].terms
    assert terms[0, TERMS.index("positive")] > 0.9
    assert ((terms >= 0) & (terms <= 1)).all()


@pytest.mark.parametrize("case", ["no mask", "no depth", "no hand"])
def test_scenes_without_a_region_are_reported_in_one_sentence(case: str) -> None:
    scene, _ = rod(right=near_end)
    if case == "no mask":
        scene = replace(rod(right=nothing)[0], hands=np.array([False, True]))
    if case == "no depth":
        scene = replace(scene, depth_m=np.where(scene.region[1], 0.0, scene.depth_m).astype(np.float32))
    if case == "no hand":
        scene = replace(scene, hands=np.array([False, False]))
    with pytest.raises(ValueError, match=r"^rod: expected a region with depth for the .+, got .+; ") as caught:
        grasp_candidates.run(scene, PARAMS)
    assert "\n" not in str(caught.value)


def test_grasps_rotate_with_the_rod() -> None:
    """Another yaw of the rod rotates the best grasp with it."""
    looks = (rod(right=everything), rod(right=everything, yaw_rad=0.5))
    yaw = [Rotation.from_matrix(in_world(T, right(scene))[0, :3, :3]) for scene, T in looks]
    turned = (yaw[1] * yaw[0].inv()).as_rotvec()
    assert abs(turned[2] - 0.5) % np.pi == pytest.approx(0.0, abs=0.15) or abs(turned[2] - 0.5 + np.pi) < 0.15
