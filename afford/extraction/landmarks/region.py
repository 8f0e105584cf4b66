"""Rotated square region of a picture: the crop that a network reads, and its points back in the picture.

Coordinates are pixel indices: (0, 0) is the centre of the first pixel, and the corner of a region falls on the first pixel of its
crop. This is the convention of MediaPipe's ImageToTensorCalculator, as is the grid of 1/32 px of the OpenCV 3 in it: newer releases
sample exactly, which moves landmarks by 0.3 px.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

GRID = 32
"""sampling positions in a pixel, of OpenCV's fixed-point maps"""
FAR_PX = 30_000
"""beyond every picture, within int16"""


@dataclass(frozen=True)
class Region:
    """Rotated square in a picture; at angle 0 the crop is upright, at a positive angle it is turned clockwise."""

    x_px: float
    """centre, to the right"""
    y_px: float
    """centre, down"""
    side_px: float
    angle_rad: float = 0.0
    """-pi to pi, clockwise in the picture"""

    def crop(self, rgb: np.ndarray, size_px: int, border: int = cv2.BORDER_REPLICATE) -> np.ndarray:
        """Sample the region of rgb (h, w, 3) uint8 as (size_px, size_px, 3) uint8: bilinear, at multiples of 1/32 px."""
        along = np.arange(size_px) / size_px
        x, y = np.moveaxis(np.rint(self.to_picture(np.stack(np.meshgrid(along, along), -1)) * GRID).astype(np.int32), -1, 0)
        whole = np.stack([x // GRID, y // GRID], -1).clip(-FAR_PX, FAR_PX).astype(np.int16)
        part = (y % GRID * GRID + x % GRID).astype(np.uint16)
        return cv2.remap(rgb, whole, part, cv2.INTER_LINEAR, borderMode=border)

    def to_picture(self, points: np.ndarray) -> np.ndarray:
        """Map points (..., 2), fractions 0..1 of the crop, to pixels of the picture, float64."""
        return ((points - 0.5) * self.side_px) @ rotation(self.angle_rad).T + np.array([self.x_px, self.y_px])

    def rotate(self, points: np.ndarray) -> np.ndarray:
        """Rotate x and y of points (..., 3) from the axes of the crop to those of the picture, float64."""
        return np.concatenate([points[..., :2] @ rotation(self.angle_rad).T, points[..., 2:]], -1)


def rotation(angle_rad: float) -> np.ndarray:
    """Matrix (2, 2) of a clockwise rotation in a picture, where y points down."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])


def upright_angle(start_px: np.ndarray, end_px: np.ndarray) -> float:
    """Angle of a region in which the vector from start to end (2,) points up, -pi to pi."""
    x, y = end_px - start_px
    angle = np.pi / 2 - np.arctan2(-y, x)
    return float(angle - 2 * np.pi * np.floor((angle + np.pi) / (2 * np.pi)))


def enlarged(centre_px: np.ndarray, size_px: np.ndarray, angle_rad: float, scale: float, shift_y: float) -> Region:
    """Square around a rotated rectangle: its longer side times `scale`, moved along its own y axis by `shift_y` of its height."""
    x, y = centre_px + rotation(angle_rad) @ np.array([0.0, shift_y * size_px[1]])
    return Region(float(x), float(y), float(max(size_px)) * scale, angle_rad)
