"""Hand landmarks in torch compared with MediaPipe itself on real pictures: same hands, landmarks, handedness, and video mode."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.extraction.landmarks.files import FOLDER, HAND, PALM
from afford.extraction.landmarks.landmarks import HandLandmarker
from afford.extraction.landmarks.palm import PalmDetector
from afford.extraction.landmarks.tracking import HandTracker
from tests.helpers.mediapipe_library import Answer, library_python, reference

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "tabletop"
NETWORKS = Path(sys.prefix) / FOLDER
FRAMES, STEP = 120, 8
Reference = Callable[[np.ndarray, bool, float], list[Answer]]

pytestmark = [pytest.mark.mediapipe, pytest.mark.skipif(not (NETWORKS / PALM).is_file(), reason="run `make setup`")]


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Reference:
    """The library, in an environment of its own."""
    folder = tmp_path_factory.mktemp("library")
    python = library_python(folder)
    if python is None:
        pytest.skip("mediapipe==0.10.21 cannot be installed here")
    return lambda pictures, static, score: reference(python, pictures, static, folder, score)


@pytest.fixture(scope="module", params=["P90_01", "P90_02"])
def video(request: pytest.FixtureRequest) -> np.ndarray:
    """First frames (n, 720, 1280, 3) of a real clip."""
    path = DATA / "videos" / "P90" / f"{request.param}.MP4"
    if not path.is_file():
        pytest.skip("the real clips are not here")
    source = cv2.VideoCapture(str(path))
    return np.stack([cv2.cvtColor(source.read()[1], cv2.COLOR_BGR2RGB) for _ in range(FRAMES)])


def tracker(score: float) -> HandTracker:
    return HandTracker(PalmDetector(NETWORKS / PALM), HandLandmarker(NETWORKS / HAND), min_score=score)


@pytest.mark.parametrize("score", [0.5, 0.2])
def test_stills_agree(library: Reference, video: np.ndarray, score: float) -> None:
    """The same hands in the same order; points within 0.1 px on average and 1 px at most."""
    track, pictures, hands = tracker(score), video[::STEP], 0
    for picture, answer in zip(pictures, library(pictures, True, score), strict=True):
        track.reset()
        found = track.track(picture)
        assert len(found) == len(answer.hands)
        for mine, theirs in zip(found, answer.hands, strict=True):
            distance = np.linalg.norm(mine.points_px - theirs.points_px, axis=1)
            assert distance.mean() < 0.1 and distance.max() < 1
            assert np.abs(mine.depth_px - theirs.depth_px).max() < 1
            assert np.abs(mine.points_m - theirs.points_m).max() < 5e-4
            assert mine.right == pytest.approx(theirs.right, abs=0.01)
            hands += 1
    assert hands >= len(pictures) / 2


def test_video_mode_agrees(library: Reference, video: np.ndarray) -> None:
    """Almost equal landmarks in the first frames, and the same hands later.

    Each frame starts from the landmarks of the one before, which amplifies differences in the last digits about threefold a frame.
    """
    track, distances, same = tracker(0.5), [], 0
    for picture, answer in zip(video, library(video, False, 0.5), strict=True):
        found = track.track(picture)
        if len(found) == len(answer.hands):
            same += 1
            distances += [np.linalg.norm(mine.points_px - theirs.points_px, axis=1).mean()
                          for mine, theirs in zip(found, answer.hands, strict=True)]  # fmt: skip
    assert same >= 0.95 * len(video)
    assert np.mean(distances[:3]) < 0.2 and np.median(distances) < 2
