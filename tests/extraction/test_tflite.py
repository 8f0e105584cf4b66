"""TFLite networks in torch: the outputs of OpenCV, the same bytes every time, and one sentence for another file."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from afford.extraction.landmarks.files import FOLDER, HAND, PALM
from afford.extraction.landmarks.tflite import TfliteNetwork

NETWORKS = Path(sys.prefix) / FOLDER
fetched = pytest.mark.skipif(not (NETWORKS / PALM).is_file(), reason="run `python install/landmark_files.py`")
CASES = [(PALM, 192, 1e-2), (HAND, 224, 1e-2)]


def pictures(count: int, side: int) -> np.ndarray:
    """Smooth random pictures (count, side, side, 3) uint8."""
    small = np.random.default_rng(3).random((count, 12, 12, 3))
    return np.stack([(255 * cv2.resize(one, (side, side))).astype(np.uint8) for one in small])


@fetched
@pytest.mark.parametrize(("name", "side", "tolerance"), CASES)
def test_outputs_are_those_of_opencv(name: str, side: int, tolerance: float) -> None:
    """Every output by name, in pixels, logits or probabilities."""
    ours = TfliteNetwork(NETWORKS / name)
    theirs = cv2.dnn.readNetFromTFLite(str(NETWORKS / name), engine=cv2.dnn.ENGINE_CLASSIC)
    for picture in pictures(3, side):
        found = ours(picture[None])
        theirs.setInput(cv2.dnn.blobFromImage(picture, 1 / 255))
        for output, expected in zip(found, theirs.forward(list(found)), strict=True):
            assert found[output].shape == expected.shape and np.abs(found[output] - expected).max() < tolerance, output


@fetched
@pytest.mark.parametrize(("name", "side", "tolerance"), CASES)
def test_pictures_do_not_depend_on_their_batch(name: str, side: int, tolerance: float) -> None:
    """The same bytes for the same picture, and nearly the same in a batch."""
    network, several = TfliteNetwork(NETWORKS / name), pictures(3, side)
    batch, single = network(several), [network(picture[None]) for picture in several]
    again = TfliteNetwork(NETWORKS / name)(several[:1])
    for output, values in batch.items():
        assert np.array_equal(again[output], single[0][output])
        assert np.abs(values - np.concatenate([one[output] for one in single])).max() < tolerance, output


@pytest.mark.parametrize("content", [b"", b"TFL3", b"\xff" * 64, bytes(64), b"\x1c\x00\x00\x00TFL3" + bytes(40)])
def test_another_file_is_refused(tmp_path: Path, content: bytes) -> None:
    """One sentence with the path and what to do."""
    path = tmp_path / "network.tflite"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"network\.tflite: no TFLite network that can be read .* install/landmark_files\.py"):
        TfliteNetwork(path)


@fetched
def test_damaged_files_are_read_or_refused(tmp_path: Path) -> None:
    """A network cut short, and networks with changed bytes outside the weights: no other error than ValueError."""
    content, random, refused = (NETWORKS / PALM).read_bytes(), np.random.default_rng(5), 0
    for case in range(60):
        damaged = bytearray(content[: random.integers(len(content))] if case < 20 else content)
        for place in random.integers(0, min(len(damaged), 400), 4):
            damaged[place] = random.integers(256)
        path = tmp_path / "network.tflite"
        path.write_bytes(damaged)
        try:
            TfliteNetwork(path)
        except ValueError:
            refused += 1
    assert refused >= 10
