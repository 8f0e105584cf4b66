"""Geometry around the hand landmark networks: regions, weighted NMS, the next region, and tracking."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from afford.extraction.landmarks.landmarks import Landmarks
from afford.extraction.landmarks.palm import Palm, weighted_nms
from afford.extraction.landmarks.region import Region, upright_angle
from afford.extraction.landmarks.tracking import HandTracker, distinct

ANGLES = st.floats(-3.1, 3.1)


def picture(height: int = 90, width: int = 160) -> np.ndarray:
    """A smooth picture, in which bilinear sampling is exact: red grows to the right, green downwards."""
    y, x = np.mgrid[:height, :width]
    return np.stack([x, y, 0 * x], -1).astype(np.uint8)


@settings(max_examples=30, deadline=None)
@given(ANGLES, st.floats(10, 40))
def test_a_crop_and_its_points_agree(angle: float, side: float) -> None:
    """The colour of each pixel of a crop is that of the picture at the point to which it maps."""
    region = Region(80, 45, side, angle)
    crop = region.crop(picture(), 32).astype(float)
    v, u = np.mgrid[:32, :32]
    expected = region.to_picture(np.stack([u, v], -1) / 32)
    assert np.abs(crop[..., :2] - expected).max() < 1


def test_outside_the_picture_is_black_or_the_nearest_pixel() -> None:
    """The palm detector reads black borders, the landmark network repeated ones."""
    region, grey = Region(0, 45, 60), np.full((90, 160, 3), 200, np.uint8)
    assert (region.crop(grey, 20, 0)[:, :9] == 0).all() and (region.crop(grey, 20) == 200).all()


@settings(max_examples=50, deadline=None)
@given(ANGLES)
def test_fingers_point_up_in_a_crop(angle: float) -> None:
    """The vector from wrist to fingers maps to (0, -1), whatever its direction."""
    start = np.array([80.0, 45.0])
    end = start + 20 * np.array([np.sin(angle), -np.cos(angle)])
    assert upright_angle(start, end) == pytest.approx(angle, abs=1e-9)


def hand(angle: float = 0.0, at: tuple[float, float] = (80.0, 45.0), scale: float = 1.0) -> np.ndarray:
    """Points (21, 2) of an open hand with the fingers up, then rotated, scaled and moved."""
    points = np.zeros((21, 2))
    points[0] = 0, 20
    for finger, across in enumerate((-16, -8, 0, 7, 14)):
        points[1 + 4 * finger : 5 + 4 * finger] = np.stack([np.full(4, across), np.linspace(0, -18, 4)], 1)
    cos, sin = np.cos(angle), np.sin(angle)
    return scale * points @ np.array([[cos, sin], [-sin, cos]]) + at


def landmarks(points: np.ndarray, presence: float = 1.0) -> Landmarks:
    return Landmarks(points, np.zeros(21), np.zeros((21, 3)), presence, 1.0, Region(0, 0, 1))


@settings(max_examples=50, deadline=None)
@given(ANGLES, st.floats(0.5, 3))
def test_the_next_region_moves_with_the_hand(angle: float, scale: float) -> None:
    """Rotating, scaling and moving a hand does the same to its next region."""
    first, other = (landmarks(points).next_region() for points in (hand(), hand(angle, (50, 60), scale)))
    cos, sin = np.cos(angle), np.sin(angle)
    offset = scale * np.array([[cos, -sin], [sin, cos]]) @ np.array([first.x_px - 80, first.y_px - 45])
    assert (other.x_px, other.y_px) == pytest.approx((50 + offset[0], 60 + offset[1]))
    assert other.side_px == pytest.approx(scale * first.side_px)
    assert np.angle(np.exp(1j * (other.angle_rad - first.angle_rad - angle))) == pytest.approx(0, abs=1e-9)


def test_the_region_of_a_palm_is_ahead_of_it() -> None:
    """2.6 times the palm, moved by half of it towards the fingers: here to the right."""
    points = np.tile([50.0, 40.0], (7, 1))
    points[0], points[2] = (40, 40), (60, 40)
    region = Palm(1.0, np.array([40.0, 30.0, 60.0, 50.0]), points).region()
    assert (region.x_px, region.y_px, region.side_px, region.angle_rad) == pytest.approx((60, 40, 52, np.pi / 2))


def box(x: float, y: float = 0.0, side: float = 1.0) -> np.ndarray:
    return np.array([[x, y], [x + side, y + side], [x, y]])


def test_nms_averages_overlapping_boxes_by_score() -> None:
    """One detection for each group, best first, with the score of the best."""
    found = weighted_nms(np.array([0.2, 0.9, 0.6, 0.5]), np.stack([box(5), box(0), box(0.3), box(9)]))
    assert [score for score, _ in found] == [0.9, 0.5, 0.2]
    assert np.allclose(found[0][1], box(0.3 * 0.6 / 1.5))


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 3), st.floats(0, 3), st.floats(0, 2), st.floats(0.01, 1)), max_size=12))
def test_nms_uses_each_detection_once(boxes: list[tuple[float, float, float, float]]) -> None:
    """Termination, also for boxes without area, with at most as many detections as before."""
    scores = np.array([score for *_, score in boxes])
    points = np.array([box(x, y, side) for x, y, side, _ in boxes]).reshape(-1, 3, 2)
    found = weighted_nms(scores, points)
    assert len(found) <= len(boxes) and bool(found) == bool(boxes)
    assert [score for score, _ in found] == sorted((score for score, _ in found), reverse=True)
    assert all((points.min(0) - 1e-9 <= one).all() and (one <= points.max(0) + 1e-9).all() for _, one in found)


def test_a_later_region_replaces_the_one_it_covers() -> None:
    """The last of several regions of a hand is kept; rotation does not count."""
    palm, tracked, other = Region(10, 10, 20), Region(12, 10, 20, 1.0), Region(60, 10, 20)
    assert distinct([palm, other, tracked]) == [other, tracked]
    assert distinct([palm, other]) == [palm, other]


class Scene:
    """Detector and landmark network of a scene with hands at fixed places; counts detections."""

    def __init__(self, *places: float) -> None:
        self.places, self.detections = list(places), 0

    def detect(self, rgb: np.ndarray, min_score: float = 0.5, window: Any = None) -> list[Palm]:
        self.detections += 1
        points = [hand(at=(x, 45)) for x in self.places]
        return [Palm(0.9, np.array([x - 12, 33, x + 12, 57]), at[[0, 5, 9, 13, 17, 1, 2]])
                for x, at in zip(self.places, points, strict=True)]  # fmt: skip

    def landmarks(self, rgb: np.ndarray, region: Region) -> Landmarks:
        x = min(self.places, key=lambda x: abs(x - region.x_px), default=1e9)
        return landmarks(hand(at=(x, 45)), float(abs(x - region.x_px) < 40))


def tracker(scene: Scene) -> HandTracker:
    return HandTracker(scene, scene, max_hands=2)  # type: ignore[arg-type]  # stands for both networks


def test_palms_are_detected_only_while_hands_are_missing() -> None:
    """Two tracked hands need no detection; with one left, every frame does."""
    scene = Scene(100.0, 300.0)
    track, rgb = tracker(scene), picture()
    assert [len(track.track(rgb)) for _ in range(4)] == [2] * 4 and scene.detections == 1
    scene.places = [104.0]
    assert [len(track.track(rgb)) for _ in range(3)] == [1] * 3 and scene.detections == 3


def test_a_tracked_hand_is_not_found_twice() -> None:
    """A palm in the region of a tracked hand adds none, and a third hand is beyond the limit."""
    scene = Scene(100.0)
    track, rgb = tracker(scene), picture()
    assert [len(track.track(rgb)) for _ in range(3)] == [1] * 3 and scene.detections == 3
    scene = Scene(100.0, 300.0, 500.0)
    assert len(tracker(scene).track(rgb)) == 2


def test_a_reset_forgets_the_hands() -> None:
    """No hand is tracked across a cut."""
    scene = Scene(100.0, 300.0)
    track = tracker(scene)
    track.track(picture())
    scene.places = []
    track.reset()
    assert track.track(picture()) == [] and scene.detections == 2
