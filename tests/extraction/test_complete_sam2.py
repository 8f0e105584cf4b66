"""SAM 2 as a completion backend, on a tiny random model."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from afford.extraction.complete.sam2 import complete
from schemas.masks import Entity, Tracks
from schemas.video import Frames, Inpainted
from tests.helpers.tiny_models import save_sam2_video


def test_an_object_out_of_sight_stays_empty(tmp_path: Path) -> None:
    """Frames without a visible mask are not guessed; the others have a confidence between 0 and 1."""
    folder = save_sam2_video(tmp_path)
    t, h, w = 3, 32, 48
    rgb = np.random.default_rng(2).integers(0, 255, (t, h, w, 3), np.uint8)
    frame, time = np.arange(1, t + 1), np.arange(t, dtype=np.int64)
    masks = np.zeros((1, t, h, w), bool)
    masks[0, :2, 8:24, 10:30] = True
    one = np.ones((1, t))
    tracks = Tracks("c", (Entity("mug", "mug", 13, "object", ""),), frame, masks, one.astype(np.float32), one.astype(np.uint8),
                    one.astype(np.int64), one.astype(np.int32), -np.ones((2, t), np.int16), -np.ones((2, t), np.int32))  # fmt: skip
    empty = np.zeros((t, h, w))
    inpainted = Inpainted("c", frame, rgb, empty > 0, empty.astype(np.uint8), empty.astype(np.uint8))
    params = SimpleNamespace(model=str(folder), device="cpu", dtype="float32")
    found = complete(Frames("c", frame, time, rgb), tracks, inpainted, 0, params)
    assert not found.masks[2].any() and found.confidence[2] == 0
    assert ((found.confidence >= 0) & (found.confidence <= 1)).all()
