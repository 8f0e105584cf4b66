"""Dense optical flow between two frames, and how to follow it: DIS (Kroeger et al. 2016) on grey images.

A flow (h, w, 2) float32 from frame a to frame b says for each pixel x of a that it lies at x + flow(x) in b, in px, (x, y).
A map (h, w, 2) float32 holds such positions themselves.
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
    """Flow from grey image `a` to `b`, both (h, w) uint8; `start` is a flow to begin from. Deterministic."""
    engine = cv2.DISOpticalFlow_create(PRESETS[preset])
    return engine.calc(a, b, None if start is None else start.copy())


@cache
def identity_map(height_px: int, width_px: int) -> np.ndarray:
    """Map (h, w, 2) float32 that leaves every pixel where it is. Read-only."""
    y, x = np.mgrid[:height_px, :width_px].astype(np.float32)
    grid = np.dstack([x, y])
    grid.flags.writeable = False
    return grid


def sample(image: np.ndarray, where: np.ndarray, outside: float = 0.0) -> np.ndarray:
    """Bilinear values of `image` (h, w[, c]) at the positions of a map; `outside` beyond the border."""
    border = (outside,) * 4
    return cv2.remap(image, where, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=border)


def disagreement(forward: np.ndarray, backward: np.ndarray) -> np.ndarray:
    """Distance in px by which following `forward` and then `backward` misses the start. (h, w) float32, large outside."""
    where = identity_map(*forward.shape[:2]) + forward
    back = sample(backward, where, outside=1e4)
    return np.linalg.norm(forward + back, axis=2)
