"""The real loading and sampling code of the four-frame diffusion model, on a tiny random one that the test saves itself."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from afford.backends.inpaint.vidm import context, inpaint
from afford.models.vidm import load_model
from schemas.masks import Tracks
from schemas.video import Frames, PixelSource
from tests.tiny_models import save_vidm


@pytest.fixture(scope="module")
def params(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    folder = save_vidm(tmp_path_factory.mktemp("vidm"))
    return SimpleNamespace(model=str(folder), ddim_steps=2, ddim_eta=1.0, seed=7)


def clip() -> tuple[Frames, Tracks, np.ndarray]:
    t, h, w = 4, 32, 56
    frame = np.arange(1, t + 1)
    rgb = np.random.default_rng(0).integers(0, 255, (t, h, w, 3), np.uint8)
    no = np.zeros((0, t))
    tracks = Tracks("c", (), frame, np.zeros((0, t, h, w), bool), no.astype(np.float32), no.astype(np.uint8),
                    no.astype(np.int64), no.astype(np.int32), -np.ones((2, t), np.int16), -np.ones((2, t), np.int32))  # fmt: skip
    hole = np.zeros((t, h, w), bool)
    hole[1:3, 8:24, 16:40] = True
    return Frames("c", frame, np.arange(t, dtype=np.int64), rgb), tracks, hole


def test_only_frames_with_a_hole_are_touched(params: SimpleNamespace) -> None:
    """Frames without a hole are copied; the source map marks the hole and nothing else."""
    frames, tracks, hole = clip()
    found = inpaint(frames, tracks, hole, params)
    assert np.array_equal(found.rgb[[0, 3]], frames.rgb[[0, 3]])
    assert np.array_equal(found.source != PixelSource.ORIGINAL, hole)


def test_same_seed_same_bytes(params: SimpleNamespace) -> None:
    """The noise comes from the seed alone."""
    one, two = (inpaint(*clip(), params).rgb.tobytes() for _ in range(2))
    other = inpaint(*clip(), SimpleNamespace(**{**vars(params), "seed": 8})).rgb.tobytes()
    assert one == two != other


def test_the_target_is_last_and_appears_once() -> None:
    """Four frames give each frame once as the target, with the three others as context."""
    assert [context(t, 4) for t in range(4)] == [[1, 2, 3, 0], [2, 3, 0, 1], [3, 0, 1, 2], [0, 1, 2, 3]]


def test_a_missing_or_foreign_model_is_refused(tmp_path: Path) -> None:
    """The sentence says what was expected."""
    with pytest.raises(ValueError, match="needs a model"):
        load_model("")
    with pytest.raises(ValueError, match="expected unet/"):
        load_model(str(tmp_path))
