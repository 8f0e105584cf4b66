"""Crops around one hand for the network of held objects: place and size from the mask of the hand alone, to a square and back."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

SIDE = 11.0
"""side of a crop, in radii of the largest circle within the hand: about two lengths of a hand"""
LEAST_RADIUS_PX = 3.0


@dataclass(frozen=True)
class HandCrop:
    """Square crop of a picture."""

    to_crop: np.ndarray
    """(2, 3) from pixels of the picture to those of the crop"""
    size_px: int

    @staticmethod
    def around(hand: np.ndarray, size_px: int, scale: float = 1.0, turn_rad: float = 0.0, shift: tuple[float, float] = (0.0, 0.0),
               ) -> HandCrop:  # fmt: skip
        """Crop around the palm of a hand (h, w) bool; `shift` is a share of the side."""
        x, y, radius = palm_circle(hand)
        side = SIDE * max(radius, LEAST_RADIUS_PX) * scale
        zoom, c, s = size_px / side, np.cos(turn_rad), np.sin(turn_rad)
        linear = zoom * np.array([[c, -s], [s, c]])
        centre = np.array([x, y]) + np.array(shift) * side
        return HandCrop(np.c_[linear, np.full(2, (size_px - 1) / 2) - linear @ centre], size_px)

    def picture(self, rgb: np.ndarray) -> np.ndarray:
        """Crop a picture (h, w, 3) uint8."""
        zoom = float(np.hypot(*self.to_crop[0, :2]))
        soft = cv2.GaussianBlur(rgb, (0, 0), 0.5 / zoom) if zoom < 0.7 else rgb
        return self._warped(np.ascontiguousarray(soft), cv2.INTER_LINEAR, cv2.BORDER_REPLICATE)

    def mask(self, mask: np.ndarray) -> np.ndarray:
        """Crop a mask (h, w) bool or of small numbers; False beyond the picture."""
        return self._warped(np.ascontiguousarray(mask).astype(np.uint8), cv2.INTER_NEAREST, cv2.BORDER_CONSTANT).astype(mask.dtype)

    def paste(self, values: np.ndarray, shape: tuple[int, ...], beyond: float) -> np.ndarray:
        """Map values (s, s) float32 of the crop to the picture (h, w); `beyond` is the value outside the crop."""
        return np.asarray(cv2.warpAffine(values, self.to_crop, shape[1::-1], flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                                         borderMode=cv2.BORDER_CONSTANT, borderValue=beyond))  # fmt: skip

    def _warped(self, image: np.ndarray, how: int, border: int) -> np.ndarray:
        return np.asarray(cv2.warpAffine(image, self.to_crop, (self.size_px, self.size_px), flags=how, borderMode=border))


def palm_circle(hand: np.ndarray) -> tuple[float, float, float]:
    """Centre and radius (x, y, r) of the largest circle within the mask of a hand (h, w) bool, px."""
    inside = cv2.distanceTransform(np.pad(hand, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    y, x = np.unravel_index(int(inside.argmax()), inside.shape)
    return float(x), float(y), float(inside[y, x])
