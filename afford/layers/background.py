"""The background behind the hands: its lit colours from all frames, under the shadows of this one."""

from __future__ import annotations

import cv2
import numpy as np

from afford.layers.camera import Background
from afford.layers.gather import gather_colour
from afford.layers.relight import log_ratio
from afford.layers.shadow import SHRINK, cast_shadows

LIT_QUANTILE = 0.7
NEAR, SPREAD = 10, 22
"""frames to look into: the nearest ones, and ones evenly spread over the group"""
GRID_PX = 2
SHADOW_STEP = 4


class BackgroundFill:
    """Looks up lit colours of the background, and knows the shadows that fall on it. `log_shadow` (t, h, w) at 1 / SHRINK."""

    def __init__(self, rgb: np.ndarray, usable: np.ndarray, background: Background) -> None:
        """rgb: (t, h, w, 3) uint8. usable: (t, h, w) bool, pixels that show the background."""
        self.rgb, self.usable, self.background = rgb, usable, background

    def lit(self, t: int, pixels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Colour (m, 3) float32 of pixels (m, 2) x, y of frame `t` in light, and the number of frames (m,) that show it."""
        points = self.background.scene_points(t, pixels, self.usable.shape[1:])
        rows = self._sources(t)
        cameras = self.background.cameras[rows]
        return gather_colour(points, cameras, rows, np.ones(len(rows)), self.rgb, self.usable, LIT_QUANTILE)

    def _sources(self, t: int) -> np.ndarray:
        group = np.flatnonzero(self.background.group == self.background.group[t])
        group = group[group != t]
        near = group[np.argsort(np.abs(group - t), kind="stable")[:NEAR]]
        spread = group[np.unique(np.linspace(0, len(group) - 1, SPREAD).astype(int))] if len(group) else group
        return np.unique(np.concatenate([near, spread]))

    def shadows(self, arms: list[np.ndarray]) -> np.ndarray:
        """Log ratio (t, h, w) float32 at 1 / SHRINK that the shadows of `arms`, each (t, h, w) bool, cause."""
        survey = [self._darkening(t) for t in range(len(self.rgb))]
        ratio, weight = (np.stack(part) for part in zip(*survey, strict=True))
        small = [np.stack([shrink(mask.astype(np.float32)) for mask in arm]) for arm in arms]
        return cast_shadows(ratio, weight, small, SHADOW_STEP)

    def _darkening(self, t: int) -> tuple[np.ndarray, np.ndarray]:
        """Small log ratio of the frame to its lit background, and how far it is known."""
        y, x = np.mgrid[0 : self.rgb.shape[1] : GRID_PX, 0 : self.rgb.shape[2] : GRID_PX]
        colour, found = self.lit(t, np.stack([x.ravel(), y.ravel()], axis=1))
        known = (found > 2).reshape(x.shape) & self.usable[t][y, x]
        ratio, weight = log_ratio(self.rgb[t][y, x], colour.reshape(*x.shape, 3), known)
        return _shrunk(ratio, weight, SHRINK // GRID_PX)


def shrink(image: np.ndarray, factor: int = SHRINK) -> np.ndarray:
    """(h, w) float32 averaged over blocks of `factor` x `factor` pixels."""
    size = (-(-image.shape[1] // factor), -(-image.shape[0] // factor))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def _shrunk(values: np.ndarray, weight: np.ndarray, factor: int) -> tuple[np.ndarray, np.ndarray]:
    mass = shrink(weight, factor)
    return shrink(values * weight, factor) / np.maximum(mass, 1e-3), mass

