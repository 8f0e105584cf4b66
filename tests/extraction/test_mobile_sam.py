"""Laws of segmentation with MobileSAM's real networks, which set-up fetches; skipped without them."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from afford.common.masks import iou
from afford.extraction.prompted.files import DECODER, ENCODER, segment_files
from afford.extraction.prompted.mobile_sam import segmenter
from schemas.files import FileRef, FileTree

Y, X = np.mgrid[:240, :320]
BALL, BOX = np.hypot(X - 90, Y - 120) < 40, (abs(X - 230) < 45) & (abs(Y - 110) < 35)


@pytest.fixture(scope="module")
def networks() -> FileTree:
    """Return the networks of set-up."""
    found = segment_files(lambda path: hashlib.sha256(path.read_bytes()).hexdigest())
    if found is None:
        pytest.skip("run `python install/segment_files.py`")
    return found


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    """Draw a red ball and a blue box on a textured table."""
    rough = np.random.default_rng(5).integers(-12, 12, (240, 320, 1))
    rgb = np.full((240, 320, 3), (170, 150, 120))
    rgb[BALL], rgb[BOX] = (190, 40, 40), (40, 60, 170)
    return np.clip(rgb + rough, 0, 255).astype(np.uint8)


def test_points_outline_what_is_there(networks: FileTree, picture: np.ndarray) -> None:
    """The object around a point has the best expected quality of the outlines at it, for both objects."""
    at = segmenter(networks, picture)
    for inside, point in ((BALL, (90, 120)), (BOX, (230, 110))):
        logits, quality = at(point)
        assert logits.shape == (4, 240, 320) and quality.shape == (4,) and logits.dtype == quality.dtype == np.float32
        assert iou(logits[int(quality.argmax())] > 0, inside) > 0.9


def test_outlines_are_the_same_bytes_on_every_call(networks: FileTree, picture: np.ndarray) -> None:
    """The same picture and point twice; a tall picture is treated as a wide one."""
    first, again = (segmenter(networks, picture)((90.0, 120.0)) for _ in range(2))
    assert np.array_equal(first.logits, again.logits) and np.array_equal(first.quality, again.quality)
    tall = segmenter(networks, np.ascontiguousarray(picture.transpose(1, 0, 2)))((120.0, 90.0))
    assert max(iou(one > 0, BALL.T) for one in tall.logits) > 0.9


@pytest.mark.parametrize("content", [b"", b"no network", b"\x08\x07" * 500])
def test_other_files_are_refused(tmp_path: Path, picture: np.ndarray, content: bytes) -> None:
    """One sentence names what to do, for bytes that are no network and for a missing file."""
    def tree(*names: str) -> FileTree:
        for name in names:
            (tmp_path / name).write_bytes(content)
        digest = hashlib.sha256(content).hexdigest()
        return FileTree("networks", tuple(FileRef(name, digest, len(content), tmp_path / name) for name in sorted(names)))

    with pytest.raises(ValueError, match=r"networks: no networks that ONNX Runtime can read .*install/segment_files\.py"):
        segmenter(tree(ENCODER, DECODER), picture)
    with pytest.raises(ValueError, match=r"networks: there is no decoder\.onnx of MobileSAM"):
        segmenter(tree(ENCODER), picture)
