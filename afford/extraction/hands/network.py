"""The embedded finder: a small network that learned hands in rooms that are rendered here."""

from __future__ import annotations

import numpy as np

from afford.extraction.hands.finder import find as ask
from schemas.files import FileTree


def find(rgb: np.ndarray, params: None, weights: FileTree | None = None) -> np.ndarray:
    """`weights`: what hands_train wrote."""
    if weights is None:
        raise ValueError("backend 'network': expected the files that hands_train wrote, got none; give them as `weights`")
    return ask(rgb, weights)
