"""The real loading and tracking code of SAM 2, on a tiny random model that the test saves itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from afford.models.sam2 import load_model, track
from tests.helpers.tiny_models import save_sam2_video


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_sam2_video(tmp_path_factory.mktemp("sam2"))


def video(t: int = 4) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 255, (t, 48, 80, 3), np.uint8)


def prompt() -> np.ndarray:
    masks = np.zeros((2, 48, 80), bool)
    masks[0, 10:30, 10:30], masks[1, 10:30, 50:70] = True, True
    return masks


def test_logits_cover_every_frame_of_every_object(folder: Path) -> None:
    """Two objects prompted in a middle frame give finite logits on all frames, before and after it."""
    logits = track(load_model(str(folder)), video(), {1: prompt()})
    assert logits.shape == (2, 4, 48, 80)
    assert np.isfinite(logits).all() and (logits != -10).any(axis=(2, 3)).all()


def test_the_prompted_frame_shows_the_prompt(folder: Path) -> None:
    """A mask prompt is taken as it is: in its own frame the logits are positive inside and negative outside."""
    logits = track(load_model(str(folder)), video(2), {0: prompt()})
    for found, wanted in zip(logits[:, 0] > 0, prompt(), strict=True):
        assert (found & wanted).sum() / (found | wanted).sum() > 0.8


def test_same_model_same_video_same_bytes(folder: Path) -> None:
    """Inference is deterministic."""
    one, two = (track(load_model(str(folder)), video(3), {0: prompt()}) for _ in range(2))
    assert one.tobytes() == two.tobytes()


def test_a_missing_model_is_refused_with_a_sentence(tmp_path: Path) -> None:
    """No model, and a folder without one, say what was expected."""
    with pytest.raises(ValueError, match="needs a model"):
        load_model("")
    with pytest.raises(ValueError, match=r"expected config.json of a Sam2VideoModel"):
        load_model(str(tmp_path))
