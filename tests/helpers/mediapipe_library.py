"""MediaPipe's own Hands solution in an environment of its own, as the reference of afford.extraction.landmarks.

The environment variable AFFORD_MEDIAPIPE names a Python that has `mediapipe==0.10.21`; without it, an environment is made.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

VARIABLE, PACKAGE = "AFFORD_MEDIAPIPE", "mediapipe==0.10.21"
PROGRAM = """
import json, os, sys, time
import numpy as np
from mediapipe.python.solutions.hands import Hands
pictures, static, score = np.load(sys.argv[1], mmap_mode="r"), sys.argv[2] == "static", float(sys.argv[3])
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
height, width = pictures.shape[1:3]
solution = Hands(static_image_mode=static, max_num_hands=2, model_complexity=1, min_detection_confidence=score)
solution.process(np.zeros_like(pictures[0]))
answers = []
for picture in pictures:
    picture = np.ascontiguousarray(picture)
    started = time.process_time()
    found = solution.process(picture)
    seconds = time.process_time() - started
    hands = zip(found.multi_hand_landmarks or [], found.multi_hand_world_landmarks or [], found.multi_handedness or [])
    answers.append({"cpu_s": seconds, "hands": [{
        "points_px": [[p.x * width, p.y * height] for p in points.landmark],
        "depth_px": [p.z * width for p in points.landmark],
        "points_m": [[p.x, p.y, p.z] for p in metric.landmark],
        "right": side.classification[0].score if side.classification[0].label == "Left" else 1 - side.classification[0].score,
    } for points, metric, side in hands]})
print(json.dumps(answers))
"""
"""one thread; the library takes its picture for a mirrored one, so that its label Left is a right hand"""


class Hand(NamedTuple):
    """A hand of the library, with the fields of `Landmarks`."""

    points_px: np.ndarray
    depth_px: np.ndarray
    points_m: np.ndarray
    right: float


class Answer(NamedTuple):
    """Hands of one picture, and CPU seconds."""

    hands: list[Hand]
    cpu_s: float


def library_python(folder: Path) -> Path | None:
    """Python with the library: the one that is named, or a new environment in `folder`; None where it cannot be installed."""
    if VARIABLE in os.environ:
        return Path(os.environ[VARIABLE])
    python = folder / "mediapipe" / "bin" / "python"
    commands = [sys.executable, "-m", "venv", folder / "mediapipe"], [python, "-m", "pip", "install", "--quiet", PACKAGE]
    return None if any(subprocess.run(command, capture_output=True).returncode for command in commands) else python


def reference(python: Path, pictures: np.ndarray, static: bool, folder: Path, min_score: float = 0.5) -> list[Answer]:
    """Detect up to two hands in pictures (n, h, w, 3) uint8, each by itself (static) or as consecutive frames of a video."""
    place = folder / "pictures.npy"
    np.save(place, pictures)
    command = [str(python), "-c", PROGRAM, str(place), "static" if static else "video", str(min_score)]
    done = subprocess.run(command, capture_output=True, text=True)
    place.unlink()
    if done.returncode:
        raise RuntimeError(f"the library failed: {done.stderr[-2000:]}")
    return [Answer([Hand(np.array(hand["points_px"]), np.array(hand["depth_px"]), np.array(hand["points_m"]), hand["right"])
                    for hand in one["hands"]], one["cpu_s"]) for one in json.loads(done.stdout.splitlines()[-1])]  # fmt: skip
