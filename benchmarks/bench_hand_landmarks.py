"""Compare hand landmarks in torch with MediaPipe itself on real video; writes benchmarks/hand_landmarks.md.

    PYTHONPATH=. python benchmarks/bench_hand_landmarks.py [--data ../shared/data]

The library is installed into an environment of its own, or AFFORD_MEDIAPIPE names a Python that has it. Needs the networks that
`make setup` fetches.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import torch

from afford.extraction.landmarks.files import FOLDER, HAND, PALM
from afford.extraction.landmarks.landmarks import HandLandmarker, Landmarks
from afford.extraction.landmarks.palm import PalmDetector
from afford.extraction.landmarks.tflite import TfliteNetwork
from afford.extraction.landmarks.tracking import HandTracker
from tests.helpers.mediapipe_library import Answer, library_python, reference

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "benchmarks" / "hand_landmarks.md"
SIZE_WH = (1280, 720)
VIDEO_FRAMES = 150
NEAR_PX = 50.0
"""largest mean distance between the landmarks of one hand in both"""


class Row(NamedTuple):
    """Comparison of one clip in one mode."""

    name: str
    pictures: int
    library: int
    ours: int
    both: int
    distance_px: np.ndarray
    metric_mm: np.ndarray
    handedness: np.ndarray
    library_ms: float
    ours_ms: float


def clips(data: Path) -> Iterator[tuple[str, bool, np.ndarray]]:
    """Name, static mode or not, and pictures (n, 720, 1280, 3) of each real clip."""
    for video in sorted((data / "tabletop" / "videos").rglob("*.MP4")):
        frames = read_video(video, VIDEO_FRAMES)
        yield f"{video.stem}, stills", True, frames[::5]
        yield f"{video.stem}, video", False, frames
    stills = sorted((data / "epic_P03_101" / "rgb_frames").rglob("*.jpg"))
    if stills:
        yield "P03_101, stills", True, np.stack([sized(cv2.imread(str(path))[..., ::-1]) for path in stills])


def read_video(path: Path, count: int) -> np.ndarray:
    """First `count` frames (n, 720, 1280, 3) uint8."""
    video, frames = cv2.VideoCapture(str(path)), []
    while len(frames) < count and (read := video.read())[0]:
        frames.append(sized(read[1][..., ::-1]))
    return np.stack(frames)


def sized(rgb: np.ndarray) -> np.ndarray:
    """Resize a picture to SIZE_WH."""
    return np.ascontiguousarray(rgb if rgb.shape[1::-1] == SIZE_WH else cv2.resize(rgb, SIZE_WH, interpolation=cv2.INTER_AREA))


def run(tracker: HandTracker, pictures: np.ndarray, static: bool) -> tuple[list[list[Landmarks]], float]:
    """Hands of each picture, and CPU milliseconds a picture."""
    found, started = [], time.process_time()
    tracker.reset()
    for picture in pictures:
        found.append(tracker.track(picture))
        if static:
            tracker.reset()
    return found, 1000 * (time.process_time() - started) / len(pictures)


def compare(name: str, theirs: list[Answer], ours: list[list[Landmarks]], ours_ms: float) -> Row:
    """Match the hands of each picture by their mean landmark distance."""
    distance, metric, handedness = [], [], []
    for answer, mine in zip(theirs, ours, strict=True):
        for hand in answer.hands:
            near = min(mine, key=lambda own: _distance(own, hand.points_px).mean(), default=None)
            if near is not None and _distance(near, hand.points_px).mean() < NEAR_PX:
                distance.append(_distance(near, hand.points_px))
                metric.append(1000 * np.linalg.norm(near.points_m - hand.points_m, axis=1))
                handedness.append((near.right > 0.5) == (hand.right > 0.5))
    counts = sum(len(answer.hands) for answer in theirs), sum(map(len, ours))
    return Row(name, len(ours), *counts, len(distance), np.array(distance), np.array(metric), np.array(handedness),
               1000 * float(np.mean([answer.cpu_s for answer in theirs])), ours_ms)  # fmt: skip


def _distance(hand: Landmarks, points_px: np.ndarray) -> np.ndarray:
    return np.linalg.norm(hand.points_px - points_px, axis=1)


def page(rows: list[Row], parts: str) -> str:
    """The Markdown table."""
    head = ("clip", "pictures", "hands, library", "hands, here", "same hands", "mean px", "95 % px", "largest px", "mean mm",
            "same side", "library CPU ms", "CPU ms here")  # fmt: skip
    lines = [head, ("---", *["--:"] * (len(head) - 1))]
    for row in rows:
        d = row.distance_px
        lines.append((row.name, *map(str, row[1:5]), f"{d.mean():.2f}", f"{np.quantile(d, 0.95):.2f}", f"{d.max():.2f}",
                      f"{row.metric_mm.mean():.2f}", f"{row.handedness.mean():.2f}", f"{row.library_ms:.0f}", f"{row.ours_ms:.0f}"))
    text = ("`afford.extraction.landmarks` compared with `mediapipe==0.10.21` (`solutions.hands`, model_complexity 1, two hands, "
            f"thresholds .5) on the same pictures of 1280 x 720; of videos the first {VIDEO_FRAMES} frames. px: distance between "
            "corresponding landmarks of hands that both found. In a video each frame starts from the landmarks of the one before, "
            "which amplifies differences in the last digits. One core; CPU milliseconds of everything, a picture. "
            "Written by `benchmarks/bench_hand_landmarks.py`.")
    return "\n".join(["# Hand landmarks", "", text, "", *("| " + " | ".join(line) + " |" for line in lines), "", parts]) + "\n"


def costs(networks: Path, picture: np.ndarray) -> str:
    """CPU milliseconds of both networks in torch, and in cv2.dnn."""
    lines = [("network, one picture", "CPU ms in torch", "CPU ms in cv2.dnn"), ("---", "--:", "--:")]
    for name, side in ((PALM, 192), (HAND, 224)):
        ours = TfliteNetwork(networks / name)
        theirs = cv2.dnn.readNetFromTFLite(str(networks / name), engine=cv2.dnn.ENGINE_CLASSIC)
        small = cv2.resize(picture, (side, side), interpolation=cv2.INTER_AREA)
        theirs.setInput(cv2.dnn.blobFromImage(small, 1 / 255))
        outputs = theirs.getUnconnectedOutLayersNames()
        taken = _median_ms(partial(ours, small[None])), _median_ms(partial(theirs.forward, outputs))
        lines.append((f"`{name}`", *(f"{ms:.0f}" for ms in taken)))
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _median_ms(run: Callable[[], object]) -> float:
    taken = []
    for _ in range(25):
        started = time.process_time()
        run()
        taken.append(1000 * (time.process_time() - started))
    return float(np.median(taken))


def main() -> None:
    """Measure, then write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    cv2.ipp.setUseIPP(False)
    networks = Path(sys.prefix) / FOLDER
    tracker, rows, picture = HandTracker(PalmDetector(networks / PALM), HandLandmarker(networks / HAND)), [], None
    with tempfile.TemporaryDirectory() as folder:
        python = library_python(Path(folder))
        if python is None:
            raise SystemExit("mediapipe==0.10.21 cannot be installed here; name a Python that has it: AFFORD_MEDIAPIPE=PYTHON")
        for name, static, pictures in clips(args.data):
            theirs = reference(python, pictures, static, Path(folder))
            rows.append(compare(name, theirs, *run(tracker, pictures, static)))
            picture = pictures[0]
            print(page(rows, ""))
    if picture is None:
        raise SystemExit(f"{args.data}: no clips; name the folder of tabletop/ and epic_P03_101/ with --data")
    PAGE.write_text(page(rows, costs(networks, picture)))


if __name__ == "__main__":
    main()
