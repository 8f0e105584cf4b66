"""What is known of an object in its own coordinates: shape and brightness, learned frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.masks import iou
from afford.extraction.layers.outline import signed_distance

MARGIN = 0.35
MEMORY = 0.85
LEARN = 0.25
MAX_POINTS = 5000


@dataclass
class Canvas:
    """A grid around the object. Grid point (i, j) is the canvas point ((i - centre) / radius, ...)
    of `afford.extraction.layers.align`.
    """

    centre: np.ndarray
    """(2,) grid coordinates of the canvas origin"""
    radius: float
    """grid pixels per canvas unit"""
    seen: np.ndarray
    """(h, w) float32: evidence that the grid point has been visible"""
    inside: np.ndarray
    """(h, w) float32: how much of that evidence shows the object"""
    grey: np.ndarray
    """(h, w) float32"""

    @classmethod
    def around(cls, mask: np.ndarray) -> tuple[Canvas, np.ndarray]:
        """An empty canvas around a non-empty (h, w) bool mask, and the pose (2, 3) that lays it over the mask."""
        x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
        pad = int(MARGIN * max(width, height)) + 4
        size = (height + 2 * pad, width + 2 * pad)
        centre = np.array([(size[1] - 1) / 2, (size[0] - 1) / 2])
        radius = max(width, height) / 2
        blank = [np.zeros(size, np.float32) for _ in range(3)]
        corner = centre + np.array([x - pad, y - pad])
        return cls(centre, radius, *blank), np.array([[radius, 0, corner[0]], [0, radius, corner[1]]])

    def to_pixels(self, pose: np.ndarray) -> np.ndarray:
        """(2, 3) affine map from grid coordinates to image pixels."""
        linear = pose[:, :2] / self.radius
        return np.column_stack([linear, pose[:, 2] - linear @ self.centre])

    def look(self, image: np.ndarray, pose: np.ndarray, *, nearest: bool = False) -> np.ndarray:
        """The image (h, w) as seen from the canvas; 0 outside the image."""
        flags = (cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR) | cv2.WARP_INVERSE_MAP
        return cv2.warpAffine(image, self.to_pixels(pose), self.grey.shape[::-1], flags=flags)

    def agreement(self, visible: np.ndarray, known: np.ndarray, pose: np.ndarray) -> float:
        """Intersection over union of the canvas shape and the visible mask, where both are known. 0 when nothing is."""
        both = (self.look(known.view(np.uint8), pose, nearest=True) > 0) & (self.seen > 0.05)
        here = (self.look(visible.view(np.uint8), pose, nearest=True) > 0) & both
        mine = self.shape() & both
        return iou(here, mine)

    def learn(self, grey: np.ndarray, visible: np.ndarray, known: np.ndarray, pose: np.ndarray) -> None:
        """Take in one frame: grey (h, w) float32, visible and known (h, w) bool."""
        known_here = self.look(known.view(np.uint8), pose, nearest=True) > 0
        inside_here = (self.look(visible.view(np.uint8), pose, nearest=True) > 0) & known_here
        grey_here = self.look(grey, pose)
        fresh = inside_here & (self.inside < 0.05)
        keep = np.where(known_here, np.float32(MEMORY), np.float32(1))
        self.seen = self.seen * keep + known_here
        self.inside = self.inside * keep + inside_here
        self.grey = np.where(fresh, grey_here, np.where(inside_here, self.grey + LEARN * (grey_here - self.grey), self.grey))

    def shape(self) -> np.ndarray:
        """(h, w) bool: grid points that most of the evidence calls object."""
        return self.inside > 0.5 * self.seen

    def samples(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (m, 2), appearance (m, 2) and distance (m, 2), float32, as `align` wants them; at most about MAX_POINTS."""
        shape, known = self.shape(), self.seen > 0.05
        distance, trust = signed_distance(shape & known, known)
        stride = max(1, int(np.ceil(np.sqrt(shape.size / MAX_POINTS))))
        y, x = np.mgrid[0 : shape.shape[0] : stride, 0 : shape.shape[1] : stride].reshape(2, -1)
        points = (np.stack([x, y], axis=1) - self.centre) / self.radius
        look = np.stack([self.grey[y, x], shape[y, x]], axis=1)
        return points.astype(np.float32), look.astype(np.float32), np.stack([distance[y, x], trust[y, x]], axis=1)
