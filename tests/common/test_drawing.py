"""Labels in images are legible on any background."""

from __future__ import annotations

import ast
from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.common.drawing import draw_label

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("text", ["P93_01 #112 hard: dark, blurred", "κουζίνα ложка naïve"])
@pytest.mark.parametrize("ground", [0, 128, 255])
def test_letters_have_their_own_edge(text: str, ground: int) -> None:
    """Check that no white pixel touches the image, and that the edge covers no letter."""
    picture = np.full((24, 320, 3), (ground, ground, 90), np.uint8)
    before = picture.copy()
    draw_label(picture, text, (6, 4), 13)
    letters = (picture > 200).all(-1)
    beside = cv2.dilate(letters.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    assert letters.sum() > 10 * len(text) and (picture[beside] != before[beside]).any(-1).all()


def test_labels_do_not_use_opencv_twice() -> None:
    """Check the sources: OpenCV 5 widens letters with their thickness, so that edge and letters do not match."""
    for path in [path for room in ("afford", "stages", "benchmarks") for path in sorted((ROOT / room).rglob("*.py"))]:
        loops = [node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.For)]
        twice = [loop for loop in loops if "putText" in ast.unparse(loop) and "thick" in ast.unparse(loop.target)]
        assert not twice, f"{path.relative_to(ROOT)}:{twice[0].lineno}"
