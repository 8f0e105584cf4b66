"""SAM 2 as a propagation backend keeps the promises of the Protocol, on a tiny random model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from afford.extraction.tracks import UNKNOWN, Sam2
from afford.extraction.tracks.sam2 import propagate
from tests.helpers.tiny_models import save_sam2_video


@pytest.fixture(scope="module")
def params(tmp_path_factory: pytest.TempPathFactory) -> Sam2:
    folder: Path = save_sam2_video(tmp_path_factory.mktemp("sam2"))
    return Sam2(model=str(folder), device="cpu", dtype="float32", memory_keys=2, cache_frames=4)


def test_key_labels_come_back_as_they_were(params: Sam2) -> None:
    """At key frames the known labels are kept and the confidence is 1; elsewhere labels are valid and confidence in 0..1."""
    rgb = np.random.default_rng(1).integers(0, 255, (4, 32, 48, 3), np.uint8)
    labels = np.zeros((2, 32, 48), np.int16)
    labels[:, 4:20, 4:20], labels[:, 8:28, 28:44], labels[0, 0, 0] = 1, 2, UNKNOWN
    found = propagate(rgb, np.array([0, 3]), labels, 2, params)
    known = labels != UNKNOWN
    assert np.array_equal(found.labels[[0, 3]][known], labels[known])
    assert found.labels.min() >= 0 and found.labels.max() <= 2
    assert (found.confidence[:, [0, 3]] == 1).all() and ((found.confidence >= 0) & (found.confidence <= 1)).all()
