"""Detect hands by their landmarks alone, without a hand finder."""

from __future__ import annotations

import numpy as np

from schemas.files import FileTree


def find(rgb: np.ndarray, params: None, weights: FileTree | None = None) -> None:
    """Return no probabilities, see `Find`."""
