"""Make a fill meet its surroundings: carry the brightness ratio along the rim smoothly into the hole (shadows, exposure)."""

from __future__ import annotations

import cv2
import numpy as np

MAX_LOG = 0.9
MAX_HUE = 0.12
"""a rim pixel whose channels disagree on the log ratio by more is not the same surface in another light"""
OFFSET = 4.0
"""added to grey values, 0..255, before ratios are taken"""
SMOOTH_PX = 1.0
GRIP_SHADE, GRIP_PX = 0.15, 10.0
"""how much darker, as a log ratio, a thing is deep under the hand that holds it, and how far under the hand that begins"""


def membrane(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Smooth (h, w) float32 surface through `values` where `weight` (h, w) is positive: pull-push over a pyramid."""
    weight = weight.astype(np.float32)
    levels = [(values.astype(np.float32) * weight, weight)]
    while min(levels[-1][0].shape) > 2:
        levels.append((cv2.pyrDown(levels[-1][0]), cv2.pyrDown(levels[-1][1])))
    surface = levels[-1][0] / np.maximum(levels[-1][1], 1e-6)
    for total, mass in reversed(levels[:-1]):
        coarse = cv2.pyrUp(surface, dstsize=mass.shape[::-1])
        trust = np.minimum(mass * 4, 1)
        surface = trust * (total / np.maximum(mass, 1e-6)) + (1 - trust) * coarse
    return surface


def log_ratio(image: np.ndarray, fill: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """log(image / fill) of (h, w, 3) images where `weight` (h, w) bool: (h, w) float32, and its weight (h, w) float32 in 0..1.

    The weight falls where the channels disagree, because light changes them together.
    """
    mass = weight.astype(np.float32)
    share = np.maximum(cv2.GaussianBlur(mass, (0, 0), SMOOTH_PX), 1e-3)[..., None]
    soft = [cv2.GaussianBlur(part.astype(np.float32) * mass[..., None], (0, 0), SMOOTH_PX) / share for part in (image, fill)]
    ratio = np.log((soft[0] + OFFSET) / (soft[1] + OFFSET))
    hue = np.abs(ratio - ratio.mean(axis=2, keepdims=True)).max(axis=2)
    return np.clip(ratio.mean(axis=2), -MAX_LOG, MAX_LOG), mass / (1 + (hue / MAX_HUE) ** 4)


def relight(fill: np.ndarray, image: np.ndarray, rim: np.ndarray) -> np.ndarray:
    """Scale `fill` (h, w, 3) float32 so that it agrees with `image` (h, w, 3) on the `rim` (h, w) bool, smoothly in between."""
    return fill * np.exp(membrane(*log_ratio(image, fill, rim)))[..., None] if rim.any() else fill


def grip_shade(hole: np.ndarray) -> np.ndarray:
    """(h, w) float32 factor: 1 at the border of the `hole` (h, w) bool and darker inside it.

    A hand that closes on a thing keeps the light off it, which the rim around the hand does not show.
    """
    depth_px = cv2.distanceTransform(hole.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    shade: np.ndarray = np.exp(-GRIP_SHADE * (1 - np.exp(-depth_px / GRIP_PX)))
    return shade
