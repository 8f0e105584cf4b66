"""Measures between two images."""

from __future__ import annotations

import numpy as np


def psnr_db(found: np.ndarray, truth: np.ndarray, mask: np.ndarray | None = None) -> float:
    """Peak signal-to-noise ratio of (h, w, 3) uint8 images in dB, over the pixels of `mask` (h, w) bool.

    NaN when the mask is empty, infinity when the pixels agree.
    """
    if mask is not None:
        found, truth = found[mask], truth[mask]
    if found.size == 0:
        return float("nan")
    error = float(np.mean((found.astype(np.float64) - truth.astype(np.float64)) ** 2))
    return float("inf") if error == 0 else 10.0 * float(np.log10(255.0**2 / error))
