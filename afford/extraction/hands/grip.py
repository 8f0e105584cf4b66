"""Geometry of a grip: where a hand can hold something, and the contact of each finger."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.masks import dilate
from schemas.video import Hand

WRIST, INDEX, MIDDLE, LITTLE = 0, 5, 9, 17
"""keypoints of the palm: wrist, and the knuckles of three fingers"""
TIPS = (4, 8, 12, 16, 20)
MIN_CONFIDENCE = 0.3
"""a hand whose keypoints have a lower mean confidence counts as one without keypoints"""
GRIP = 0.5
"""largest distance from the fingers at which a hand touches, as a share of the size of the palm"""
TIP_PX, TIP_SIZE = 1.5, 0.12
"""distance of a fingertip from an object at which its contact has probability one half: least, and as a share of the palm"""


@dataclass(frozen=True)
class HandKeypoints:
    """Keypoints of one hand in all sampled frames."""

    points_px: np.ndarray
    """(k, 21, 2) float32, x, y"""
    confidence: np.ndarray
    """(k, 21) float32, 0..1; 0 in frames without landmarks"""

    def at(self, k: int) -> np.ndarray | None:
        """Return the keypoints (21, 2) of a sampled frame, None where there are none."""
        return self.points_px[k] if self.confidence[k].mean() >= MIN_CONFIDENCE else None


Keypoints = Mapping[Hand, HandKeypoints]
"""side -> keypoints; a side may be missing"""


def palm_size_px(points: np.ndarray) -> float:
    """Return the size of a palm: the larger of its length and its width, px."""
    return max(float(np.linalg.norm(points[WRIST] - points[MIDDLE])), float(np.linalg.norm(points[INDEX] - points[LITTLE])), 8.0)


def grip_ring(hand: np.ndarray, points: np.ndarray | None, ring_px: int) -> np.ndarray:
    """Mark the surroundings (h, w) bool of a hand in which it holds things: near the fingers where keypoints are given."""
    ring = dilate(hand, ring_px)
    if points is None:
        return ring
    bones = np.ones(hand.shape, np.uint8)
    for first in range(1, 21, 4):
        knuckle = points[first : first + 1] if first == 1 else 0.3 * points[WRIST] + 0.7 * points[first : first + 1]
        cv2.polylines(bones, [np.rint(np.concatenate([knuckle, points[first : first + 4]])).astype(np.int32)], False, 0)
    return ring & (cv2.distanceTransform(bones, cv2.DIST_L2, 3) < GRIP * palm_size_px(points))


def finger_contact(thing: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Compute the probability (5,) float32 of contact of thumb to little finger with an object (h, w) bool, from image distance."""
    if not thing.any():
        return np.zeros(5, np.float32)
    away = cv2.distanceTransform((~thing).astype(np.uint8), cv2.DIST_L2, 3)
    x, y = np.rint(points[list(TIPS)]).astype(int).T
    near = away[np.clip(y, 0, thing.shape[0] - 1), np.clip(x, 0, thing.shape[1] - 1)]
    scale = max(TIP_PX, TIP_SIZE * palm_size_px(points))
    return (1 / (1 + np.square(near / scale))).astype(np.float32)
