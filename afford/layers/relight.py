"""Make a fill meet its surroundings: carry the brightness ratio along the rim smoothly into the hole (shadows, exposure)."""

from __future__ import annotations

import cv2
import numpy as np

RIM_PX = 4
LIMITS = (0.4, 2.0)


def membrane(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Smooth (h, w, 3) float32 surface through `values` where `weight` (h, w) is positive: pull-push over a pyramid."""
    weight = np.repeat(weight.astype(np.float32)[..., None], values.shape[2], axis=2)
    levels = [(values.astype(np.float32) * weight, weight)]
    while min(levels[-1][0].shape[:2]) > 2:
        levels.append((cv2.pyrDown(levels[-1][0]), cv2.pyrDown(levels[-1][1])))
    surface = levels[-1][0] / np.maximum(levels[-1][1], 1e-6)
    for total, mass in reversed(levels[:-1]):
        coarse = cv2.pyrUp(surface, dstsize=mass.shape[1::-1])
        trust = np.minimum(mass * 4, 1)
        surface = trust * (total / np.maximum(mass, 1e-6)) + (1 - trust) * coarse
    return surface


def relight(fill: np.ndarray, image: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """Scale `fill` (h, w, 3) float32 so that it agrees with `image` (h, w, 3) on the `rim` (h, w) bool, smoothly in between."""
    if not rim.any():
        return fill
    ratio = (cv2.blur(image.astype(np.float32), (3, 3)) + 4) / (cv2.blur(fill, (3, 3)) + 4)
    gain = np.exp(membrane(np.log(np.clip(ratio, *LIMITS)), rim))
    return fill * np.clip(gain, *LIMITS)
