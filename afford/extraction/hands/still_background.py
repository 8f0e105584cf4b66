"""Stabilised background of sampled frames: registration by homographies, and pixels that other frames do not explain.

Everything runs at half the size of the pictures. A pixel is explained by another frame when that frame, registered by the camera
motion, has the same colour within one pixel, or a somewhat darker or brighter one, as under a shadow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

from afford.extraction.hands.motion import SampledFrames

CORNERS, QUALITY, SPACING_PX = 400, 0.005, 6
MAX_ROUND_TRIP_PX, RANSAC_PX, MIN_MATCHES = 0.5, 1.5, 12
STILL_PX = 1.0
"""a camera whose picture moves by less than this over the clip is static, px of the half size"""
OFFSETS = (1, 2, 3, 4, 6, 8, 10, 13, 16)
"""distances, in sampled frames, of the frames that may explain a pixel"""
DARKEST, BRIGHTEST = 0.6, 1.15
"""range of the ratio of brightness between a pixel and the same place in another light"""
DIFFERENCE, SOFTNESS = 40.0, 8.0
"""sum of absolute differences of the colour channels at which a pixel is half explained, and the width of the step"""


@dataclass(frozen=True)
class Unexplained:
    """Share (h, w) float32 of the earlier and of the later frames that do not explain a pixel, and the number of those frames."""

    before: np.ndarray
    after: np.ndarray
    count_before: np.ndarray
    count_after: np.ndarray

    @property
    def both(self) -> np.ndarray:
        """Least of the two shares: large only for what is there at this time alone. One-sided shares have a lower weight."""
        two = (self.count_before > 0) & (self.count_after > 0)
        return np.where(two, np.minimum(self.before, self.after), 0.3 * self.either)

    @property
    def either(self) -> np.ndarray:
        """Largest of the two shares: small only for the background."""
        return np.maximum(self.before * (self.count_before > 0), self.after * (self.count_after > 0))


class StillBackground:
    """Registered sampled frames of one run without a gap."""

    def __init__(self, sampled: SampledFrames, run: range, moving: Sequence[np.ndarray]) -> None:
        """Register the frames of `run`. moving: (h, w) bool for each of them, hands and arms, which explain nothing."""
        rgb = sampled.rgb[run.start : run.stop]
        self.shape = rgb.shape[1:3]
        self.size = (max(rgb.shape[2] // 2, 1), max(rgb.shape[1] // 2, 1))
        small = (cv2.resize(picture, self.size, interpolation=cv2.INTER_AREA) for picture in rgb)
        self._small = [cv2.GaussianBlur(picture, (0, 0), 0.7) for picture in small]
        self.exclude(moving)
        self._to_first = list(_chain(rgb, moving))
        width, height = self.size
        corners = np.array([[[0, 0], [width, 0], [0, height], [width, height]]], np.float64)
        self.static = all(np.abs(cv2.perspectiveTransform(corners, H) - corners).max() < STILL_PX for H in self._to_first)

    def exclude(self, moving: Sequence[np.ndarray]) -> None:
        """Exclude pixels (h, w) bool of each frame from the background, in place of those excluded before."""
        self._usable = [(cv2.resize(mask.astype(np.uint8) * 255, self.size, interpolation=cv2.INTER_AREA) == 0).astype(np.uint8)
                        for mask in moving]  # fmt: skip

    def unexplained(self, k: int, offsets: Sequence[int] = OFFSETS) -> Unexplained:
        """Compare frame k of the run with the frames at these distances before and after it."""
        (before, first), (after, second) = (self._share(k, step, offsets) for step in (-1, 1))
        return Unexplained(before, after, first, second)

    def _share(self, k: int, step: int, offsets: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        total, count = np.zeros(self.size[::-1], np.float32), np.zeros(self.size[::-1], np.float32)
        for j in (k + step * offset for offset in offsets):
            if 0 <= j < len(self._small):
                picture, usable = self._registered(j, k)
                different = 1 / (1 + np.exp(np.clip((DIFFERENCE - _difference(self._small[k], picture)) / SOFTNESS, -30, 30)))
                total += usable * different
                count += usable
        return total / np.maximum(count, 1), count

    def _registered(self, j: int, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Frame j as the camera of frame k shows it, and where it is usable, (h, w) uint8."""
        if self.static:
            return self._small[j], self._usable[j]
        H = np.linalg.inv(self._to_first[k]) @ self._to_first[j]
        picture = cv2.warpPerspective(self._small[j], H, self.size, borderMode=cv2.BORDER_REPLICATE)
        return picture, cv2.warpPerspective(self._usable[j], H, self.size, flags=cv2.INTER_NEAREST)


def _chain(rgb: np.ndarray, moving: Sequence[np.ndarray]) -> Iterator[np.ndarray]:
    """Homographies (3, 3) from every frame to the first one, px of the half size; the camera rests where corners are missing."""
    grey = [cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in rgb]
    half, total = np.diag([0.5, 0.5, 1.0]), np.eye(3)
    for k in range(len(grey)):
        if k:
            total = total @ half @ _homography(grey[k], grey[k - 1], ~moving[k]) @ np.linalg.inv(half)
        yield total


def _homography(grey: np.ndarray, other: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Estimate the homography (3, 3) of the background from one frame to another; identity when too few corners agree."""
    corners = cv2.goodFeaturesToTrack(grey, CORNERS, QUALITY, SPACING_PX, mask=usable.astype(np.uint8))
    if corners is None:
        return np.eye(3)
    there, found, _ = cv2.calcOpticalFlowPyrLK(grey, other, corners, None, winSize=(13, 13), maxLevel=3)
    back, _, _ = cv2.calcOpticalFlowPyrLK(other, grey, there, None, winSize=(13, 13), maxLevel=3)
    good = (np.abs(back - corners).max(-1).ravel() < MAX_ROUND_TRIP_PX) & (found.ravel() > 0)
    if good.sum() < MIN_MATCHES:
        return np.eye(3)
    cv2.setRNGSeed(0)
    H, agreeing = cv2.findHomography(corners[good], there[good], cv2.RANSAC, RANSAC_PX)
    return H if H is not None and agreeing.sum() >= MIN_MATCHES else np.eye(3)


@njit(cache=True)
def _difference(here: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Least difference (h, w) float32 of each pixel from the 3 x 3 pixels at its place in another picture, in any allowed light."""
    height, width = here.shape[:2]
    out = np.zeros((height, width), np.float32)
    for y in range(height):
        for x in range(width):
            r, g, b = float(here[y, x, 0]), float(here[y, x, 1]), float(here[y, x, 2])
            best = 1e9
            for v in range(max(y - 1, 0), min(y + 2, height)):
                for u in range(max(x - 1, 0), min(x + 2, width)):
                    p, q, s = float(other[v, u, 0]), float(other[v, u, 1]), float(other[v, u, 2])
                    light = (p * r + q * g + s * b + 100.0) / (p * p + q * q + s * s + 100.0)
                    light = min(max(light, DARKEST), BRIGHTEST)
                    best = min(best, abs(r - light * p) + abs(g - light * q) + abs(b - light * s))
            out[y, x] = best
    return out
