"""Motion as colours: each axis normalised to 0..255."""

from __future__ import annotations

import numpy as np

MIDDLE = 128
"""no motion, where the range is fixed"""


def fixed(flow: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """-limit..limit -> 1..255, what is beyond at the ends; no motion is the same colour in every clip.

    `flow` is (s, h, w, c) float; returns (s, h, w, c) uint8 and the colour of no motion, (c,) uint8.
    """
    scaled = np.clip(flow.astype(np.float32) / limit, -1, 1) * (MIDDLE - 1) + MIDDLE
    return scaled.round().astype(np.uint8), np.full(flow.shape[-1], MIDDLE, np.uint8)


def of_clip(flow: np.ndarray, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """Least..largest of the clip -> 0..255, axis by axis, as the paper says; an axis without motion is `MIDDLE`. No `limit`.

    Returns as `fixed` does; what no motion looks like depends on the clip, and is the nearest colour there is.
    """
    axes = (0, 1, 2)
    low, high = (np.float32(end(flow, axis=axes, initial=0.0)) for end in (np.min, np.max))
    span = np.where(high > low, high - low, 1)
    still = np.where(high > low, -low / span * 255, MIDDLE)
    return (flow.astype(np.float32) / span * 255 + still).round().clip(0, 255).astype(np.uint8), still.round().astype(np.uint8)
