"""Palm detection and landmarks in a real picture: windows, rotation, mirror images."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from afford.common.image_files import read_image
from afford.extraction.landmarks.files import FOLDER, HAND, PALM
from afford.extraction.landmarks.landmarks import HandLandmarker
from afford.extraction.landmarks.palm import PalmDetector
from afford.extraction.landmarks.region import Region

NETWORKS = Path(sys.prefix) / FOLDER
PICTURE = (Path(__file__).resolve().parents[3] / "shared" / "data" / "tabletop" / "rgb_frames" / "train" / "P90" / "P90_01"
           / "P90_01_frame_0000000001.jpg")  # fmt: skip
pytestmark = [pytest.mark.skipif(not (NETWORKS / PALM).is_file(), reason="run `python install/landmark_files.py`"),
              pytest.mark.skipif(not PICTURE.is_file(), reason="the real clips are not here")]  # fmt: skip


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    """A frame of 1280 x 720 with two hands."""
    return read_image(PICTURE)


@pytest.fixture(scope="module")
def detector() -> PalmDetector:
    return PalmDetector(NETWORKS / PALM)


@pytest.fixture(scope="module")
def landmarker() -> HandLandmarker:
    return HandLandmarker(NETWORKS / HAND)


def test_a_window_is_detected_like_its_cut_out(picture: np.ndarray, detector: PalmDetector) -> None:
    """The same palms in coordinates of the whole picture; outside the picture is black in both."""
    for x, y, side in ((700, 100, 500), (100, 200, 520), (900, 300, 600)):
        inside = picture[y : y + side, x : x + side]
        cut = np.zeros((side, side, 3), np.uint8)
        cut[: inside.shape[0], : inside.shape[1]] = inside
        found, expected = detector.detect(picture, 0.3, (x, y, side)), detector.detect(cut, 0.3)
        assert found and len(found) == len(expected)
        for palm, other in zip(found, expected, strict=True):
            assert palm.score == pytest.approx(other.score, abs=0.05)
            assert np.abs(palm.points_px - other.points_px - (x, y)).max() < 0.02 * side


def test_landmarks_turn_with_the_picture(picture: np.ndarray, detector: PalmDetector, landmarker: HandLandmarker) -> None:
    """A quarter turn of picture and region turns points and metric points, and nothing else."""
    turned = np.ascontiguousarray(np.rot90(picture, -1))  # clockwise: (x, y) -> (height - 1 - y, x)
    for palm in detector.detect(picture):
        region = palm.region()
        other = Region(picture.shape[0] - 1 - region.y_px, region.x_px, region.side_px, region.angle_rad + np.pi / 2)
        one, two = landmarker.landmarks(picture, region), landmarker.landmarks(turned, other)
        expected = np.stack([picture.shape[0] - 1 - one.points_px[:, 1], one.points_px[:, 0]], 1)
        assert np.abs(two.points_px - expected).max() < 0.5
        assert np.abs(two.points_m - one.points_m[:, [1, 0, 2]] * (-1, 1, 1)).max() < 1e-3
        assert (two.presence, two.right) == pytest.approx((one.presence, one.right), abs=0.01)


def test_mirror_images_swap_handedness(picture: np.ndarray, detector: PalmDetector, landmarker: HandLandmarker) -> None:
    """The person faces the camera, in the mirror image too: the right hand is on the left of both pictures."""
    for image in (picture, np.ascontiguousarray(picture[:, ::-1])):
        hands = [landmarker.landmarks(image, palm.region()) for palm in detector.detect(image)]
        assert len(hands) == 2 and all(hand.presence > 0.9 for hand in hands)
        assert all((hand.right > 0.5) == (hand.points_px[0, 0] < 640) for hand in hands)
