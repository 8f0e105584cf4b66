"""Geometry of hand landmarks in a picture: bones, size and centre of a hand, and the ray of its forearm."""

from __future__ import annotations

import cv2
import numpy as np

BONES = ((0, 1), (1, 2), (2, 3), (3, 4), (0, 5), (5, 6), (6, 7), (7, 8), (5, 9), (9, 10), (10, 11), (11, 12), (9, 13), (13, 14),
         (14, 15), (15, 16), (13, 17), (17, 18), (18, 19), (19, 20), (0, 17))  # fmt: skip
"""pairs of keypoints"""
PALM = [0, 1, 5, 9, 13, 17]
"""keypoints around the palm"""
KNUCKLES = [5, 9, 13, 17]
WRIST = 0
ARM_WIDTH = 0.42
"""half the width of a forearm at the wrist, in sizes of the hand"""
ARM_SPREAD = 1.6
"""growth of that width over `ARM_REACH` sizes: the direction of the forearm is known only roughly"""
ARM_REACH = 6.0
SUBPIXEL_BITS = 4


def hand_size(points_px: np.ndarray) -> float:
    """Size of a hand in pixels from its keypoints (21, 2): about the length of the palm, whatever the view."""
    palm = max(np.linalg.norm(points_px[0] - points_px[9]), 1.3 * np.linalg.norm(points_px[5] - points_px[17]))
    return float(max(palm, 0.6 * np.ptp(points_px, axis=0).max(), 1.0))


def palm_centre(points_px: np.ndarray) -> np.ndarray:
    """Centre (2,) of the palm, px."""
    return np.asarray(points_px[PALM].mean(0))


def arm_direction(points_px: np.ndarray) -> np.ndarray:
    """Unit vector (2,) from the knuckles to the wrist: roughly the direction of the forearm in the picture."""
    along = points_px[WRIST] - points_px[KNUCKLES].mean(0)
    return np.asarray(along / max(float(np.linalg.norm(along)), 1e-6))


def turned(vector: np.ndarray, angle_rad: float) -> np.ndarray:
    """Rotate a vector (2,) of the picture, x towards y."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def draw_hand(shape: tuple[int, int], points_px: np.ndarray, radius: float) -> np.ndarray:
    """Mask (h, w) bool of the palm and of all bones; `radius` of the bones in sizes of the hand."""
    mask = np.zeros(shape, np.uint8)
    points = _subpixel(points_px)
    thick = max(round(2 * radius * hand_size(points_px)), 1)
    for a, b in BONES:
        cv2.line(mask, points[a].tolist(), points[b].tolist(), 1, thick, cv2.LINE_8, SUBPIXEL_BITS)
    cv2.fillConvexPoly(mask, cv2.convexHull(points[PALM]), 1, cv2.LINE_8, SUBPIXEL_BITS)
    return mask > 0


def draw_forearm(shape: tuple[int, int], points_px: np.ndarray, turn_rad: float = 0.0, spread: float = ARM_SPREAD) -> np.ndarray:
    """Mask (h, w) bool of the region in which the forearm lies: it widens with the distance from the wrist, `spread` times.

    turn_rad: angle by which the wrist is bent in the picture.
    """
    size, along = hand_size(points_px), turned(arm_direction(points_px), turn_rad)
    across = np.array([-along[1], along[0]]) * ARM_WIDTH * size
    near, far = points_px[WRIST] - 0.1 * size * along, points_px[WRIST] + ARM_REACH * size * along
    corners = np.array([near - across, near + across, far + spread * across, far - spread * across])
    mask = np.zeros(shape, np.uint8)
    cv2.fillConvexPoly(mask, _subpixel(corners), 1, cv2.LINE_8, SUBPIXEL_BITS)
    return mask > 0


def distance_from(mask: np.ndarray) -> np.ndarray:
    """Distance (h, w) float32 of each pixel from a mask (h, w) bool, px; 0 inside."""
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 3))


def _subpixel(points_px: np.ndarray) -> np.ndarray:
    return np.round(points_px * (1 << SUBPIXEL_BITS)).astype(np.int32)
