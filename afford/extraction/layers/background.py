"""The background behind the hands: its colours in even light, from other frames, whatever light fell on it there."""

from __future__ import annotations

import cv2
import numpy as np

from afford.extraction.layers.camera import Background
from afford.extraction.layers.gather import gather_colour
from afford.extraction.layers.relight import log_ratio, membrane

LIT_QUANTILE = 0.7
"""of the frames that show a point, at least these many out of ten may show it in shadow: a bright one is taken for lit"""
NEAR, SPREAD = 8, 16
"""frames to look into: the nearest ones, and ones evenly spread over the group"""
FADE_FRAMES, FAR = 12.0, 0.05
"""how fast trust in a frame falls with its distance, and what is left of it far away"""
NOISE = 0.04
"""a smaller log ratio is no shadow"""
SHRINK = 4
"""light is soft: it is compared on images this many times smaller"""
SMOOTH_PX = 1.5
"""blur of the light (sigma, small pixels)"""


class BackgroundFill:
    """Looks up colours of the background that belong to a place, not to the light that fell on it when it was seen."""

    def __init__(self, rgb: np.ndarray, usable: np.ndarray, background: Background) -> None:
        """rgb: (t, h, w, 3) uint8. usable: (t, h, w) bool, pixels that show the background."""
        self.background, self.usable = background, usable
        self._small = np.stack([shrink(image.astype(np.float32)) for image in rgb])
        self._small_usable = np.stack([shrink(mask.astype(np.float32)) > 0.99 for mask in usable])
        self._even = np.stack([_even(image, *self._darkening(t)) for t, image in enumerate(rgb)])

    def colour(self, t: int, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Colour (m, 3) float32 in even light of pixels (m, 2) x, y of frame `t`, and the weight (m,) of what shows it."""
        points = self.background.scene_points(t, pixels, self.usable.shape[1:])
        rows = self._sources(t)
        weights = FAR + np.exp(-np.abs(rows - t) / FADE_FRAMES)
        return gather_colour(points, self.background.cameras[rows], rows, weights, self._even, self.usable, 0.5)

    def _sources(self, t: int) -> np.ndarray:
        group = np.flatnonzero(self.background.group == self.background.group[t])
        group = group[group != t]
        near = group[np.argsort(np.abs(group - t), kind="stable")[:NEAR]]
        spread = group[np.unique(np.linspace(0, len(group) - 1, SPREAD).astype(int))] if len(group) else group
        return np.unique(np.concatenate([near, spread]))

    def _darkening(self, t: int) -> tuple[np.ndarray, np.ndarray]:
        """Small (h, w) log ratio of the frame to its background in light, and how far it is known."""
        small = self._small[t]
        y, x = np.mgrid[0 : small.shape[0], 0 : small.shape[1]]
        at = np.stack([x.ravel(), y.ravel()], axis=1) * SHRINK + (SHRINK - 1) // 2
        points = self.background.scene_points(t, np.minimum(at, np.array(self.usable.shape[:0:-1]) - 1), self.usable.shape[1:])
        rows = self._sources(t)
        cameras = _to_small() @ self.background.cameras[rows]
        lit, found = gather_colour(points, cameras, rows, np.ones(len(rows)), self._small, self._small_usable, LIT_QUANTILE)
        known = (found > 2).reshape(x.shape) & self._small_usable[t]
        return log_ratio(small, lit.reshape(*x.shape, 3), known)


def shrink(image: np.ndarray) -> np.ndarray:
    """(h, w) or (h, w, 3) float32 averaged over blocks of SHRINK x SHRINK pixels."""
    size = (-(-image.shape[1] // SHRINK), -(-image.shape[0] // SHRINK))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def _to_small() -> np.ndarray:
    shift = (1 / SHRINK - 1) / 2
    return np.array([[1 / SHRINK, 0, shift], [0, 1 / SHRINK, shift], [0, 0, 1]])


def _even(image: np.ndarray, darkening: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The frame (h, w, 3) uint8 with its shadows lifted where they are known."""
    if not known.any():
        return image
    surface = cv2.GaussianBlur(membrane(darkening, known), (0, 0), SMOOTH_PX)
    surface = np.sign(surface) * np.maximum(np.abs(surface) - NOISE, 0)
    gain = np.exp(-cv2.resize(surface, image.shape[1::-1], interpolation=cv2.INTER_LINEAR))[..., None]
    return np.clip(np.rint(image * gain), 0, 255).astype(np.uint8)
