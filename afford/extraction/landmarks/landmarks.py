"""Hand landmarks: 21 keypoints of the hand in a region of a picture, with MediaPipe's landmark network."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from afford.extraction.landmarks.region import Region, enlarged, rotation, upright_angle
from afford.extraction.landmarks.tflite import TfliteNetwork

INPUT_PX = 224
OUTPUTS = ("Identity", "Identity_1", "Identity_2", "Identity_3")
"""(1, 63) x, y, z in pixels of the input; (1, 1) presence; (1, 1) handedness; (1, 63) metres"""
DEPTH_SCALE = 0.4
"""divisor of the library for depths of the first output"""
PALM = (0, 1, 2, 3, 5, 6, 9, 10, 13, 14, 17, 18)
"""keypoints that fix the next region: those that move little when fingers bend"""
WRIST, INDEX, MIDDLE, RING = 0, 5, 9, 13
"""wrist, and first joints of three fingers"""


@dataclass(frozen=True, eq=False)
class Landmarks:
    """Output of the landmark network for one region; keypoints in the order of schemas.hand.KEYPOINTS."""

    points_px: np.ndarray
    """(21, 2) in the picture"""
    depth_px: np.ndarray
    """(21,) relative to the wrist, away from the camera, about the scale of points_px"""
    points_m: np.ndarray
    """(21, 3) at the size of the model's hand, origin in the hand's centre; x right, y down in the picture, z away"""
    presence: float
    """probability that the region contains a hand, 0..1"""
    right: float
    """probability of a right hand, 0..1"""
    region: Region

    def next_region(self) -> Region:
        """Region of the hand in the next frame, with the fingers up."""
        palm = self.points_px[list(PALM)]
        fingers = (self.points_px[INDEX] + self.points_px[RING]) / 2
        angle = upright_angle(self.points_px[WRIST], (fingers + self.points_px[MIDDLE]) / 2)
        centre = (palm.min(0) + palm.max(0)) / 2
        turned = (palm - centre) @ rotation(angle)  # the transpose of a rotation, on rows: back by the angle
        low, high = turned.min(0), turned.max(0)
        return enlarged(centre + rotation(angle) @ ((low + high) / 2), high - low, angle, scale=2.0, shift_y=-0.1)


class HandLandmarker:
    """MediaPipe's landmark network, out of the file hand_landmark_full.tflite."""

    def __init__(self, model: Path) -> None:
        self._network = TfliteNetwork(model)

    def landmarks(self, rgb: np.ndarray, region: Region) -> Landmarks:
        """Compute the landmarks of the hand in a region of a picture (h, w, 3) uint8."""
        found = self._network(region.crop(rgb, INPUT_PX)[None])
        points, presence, right, metric = (found[name].reshape(-1).astype(np.float64) for name in OUTPUTS)
        points, metric = points.reshape(21, 3) / INPUT_PX, region.rotate(metric.reshape(21, 3))
        depth = points[:, 2] * region.side_px / DEPTH_SCALE
        return Landmarks(region.to_picture(points[:, :2]), depth, metric, float(presence[0]), float(right[0]), region)
