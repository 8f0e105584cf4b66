"""Labels are ready-made on the frames that have them (VISOR's dense interpolations); other frames stay empty."""

from __future__ import annotations

import numpy as np

from afford.extraction.tracks.propagate import BACKGROUND, UNKNOWN, Propagated


def propagate(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: None) -> Propagated:
    """Copies, propagates nothing. Confidence is 1 where a label was given."""
    labels = np.zeros(rgb.shape[:3], np.int16)
    labels[key_index] = np.where(key_labels == UNKNOWN, BACKGROUND, key_labels)
    confidence = np.zeros((count, len(rgb)), np.float32)
    for i in range(count):
        confidence[i] = (labels == i + 1).any(axis=(1, 2))
    return Propagated(labels, confidence)
