"""A small untrained model and a picture for which both of its hands' regions are partly filled."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from afford.twohands.model.interface import ModelConfig, build
from afford.twohands.model.model_folder import save_model
from afford.twohands.model.predictor import Predictor
from schemas.benchmark import Prediction

TASK = "pour tea from kettle"
CONFIG = ModelConfig(size_px=(64, 96), widths=(16, 16, 32), depth=1, decoder_depth=1, text_buckets=64)


def picture(height: int = 60, width: int = 90) -> np.ndarray:
    """(h, w, 3) uint8 RGB: soft blobs."""
    noise = np.random.default_rng(0).integers(0, 255, (6, 9, 3), np.uint8)
    return cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)


def write_picture(path: Path, rgb: np.ndarray | None = None) -> Path:
    """Write it as the suffix says."""
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), (picture() if rgb is None else rgb)[..., ::-1])
    return path


def write_model(folder: Path) -> Path:
    """Save the model; its threshold lies inside the probabilities that both hands have for the picture."""
    model = build(CONFIG, 0)
    best = [_best(Predictor(model).predict(picture(), TASK, "both"), side) for side in (0, 1)]
    least, most = max(float(one.min()) for one in best), min(float(one.max()) for one in best)
    assert least < most, "the random model has no threshold at which both regions are partly filled; take another seed"
    model.config = replace(CONFIG, threshold=round((least + most) / 2, 6))
    save_model(model, folder)
    return folder


def _best(found: Prediction, side: int) -> np.ndarray:
    probability: np.ndarray = found.probability[side, found.score[side].argmax()]
    return probability
