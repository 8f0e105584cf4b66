"""Dense optical flow between two grey images by DIS (Kroeger et al. 2016), and composition of flows.

A flow (h, w, 2) float32 from frame a to frame b maps pixel x of a to x + flow(x) in b, in px, (x, y).
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

PRESETS = {
    "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
    "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
    "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
}


def flow_between(a: np.ndarray, b: np.ndarray, preset: str = "medium", start: np.ndarray | None = None) -> np.ndarray:
    """Compute the flow between grey images (h, w) uint8, deterministically; `start` is an initial flow."""
    engine = cv2.DISOpticalFlow_create(PRESETS[preset])
    return engine.calc(a, b, None if start is None else start.copy())


@cache
def identity_map(height_px: int, width_px: int) -> np.ndarray:
    """Return the position (x, y) of every pixel, (h, w, 2) float32, read-only."""
    y, x = np.mgrid[:height_px, :width_px].astype(np.float32)
    grid = np.dstack([x, y])
    grid.flags.writeable = False
    return grid


def compose_flow(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Compose the flows a -> b and b -> c to a -> c; beyond the image border the border's flow is used."""
    where = identity_map(*first.shape[:2]) + first
    return first + cv2.remap(second, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
