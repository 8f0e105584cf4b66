"""Backgrounds of augmented pictures of hands: rendered rooms without hands, textured surfaces, and photographs of the user."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from afford.extraction.hands.augment import Augmentation, Labelled, random_crop
from afford.extraction.hands.surfaces import surface_picture, textures

TEXTURES = 160
"""textures of a training"""


@dataclass(frozen=True, eq=False)
class Backgrounds:
    """Pictures without hands; calling it draws one of a size (height, width), (h, w, 3) uint8."""

    rooms: tuple[Labelled, ...]
    """rendered rooms without hands"""
    textures: tuple[np.ndarray, ...]
    """textures of surfaces, each (s, s, 3) uint8"""
    photographs: tuple[np.ndarray, ...] = ()
    """photographs without hands, each (h, w, 3) uint8"""

    @staticmethod
    def of(rooms: Sequence[Labelled], photographs: Sequence[np.ndarray], seed: int, held_out: bool) -> Backgrounds:
        """Draw the textures of this seed, of the kinds of training or of those held out, and add rooms and photographs."""
        return Backgrounds(tuple(rooms), textures(TEXTURES, np.random.default_rng([seed, 2]), held_out), tuple(photographs))

    def __call__(self, size: tuple[int, int], rng: np.random.Generator, d: Augmentation) -> np.ndarray:
        """Draw a background."""
        if rng.random() >= d.surfaces:
            return random_crop(self.rooms[int(rng.integers(len(self.rooms)))], size, rng, d)[0]
        if self.photographs and rng.random() < d.photographed:
            return _crop(self.photographs[int(rng.integers(len(self.photographs)))], size, rng)
        return surface_picture(self.textures, size, rng)


def _crop(picture: np.ndarray, size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Crop a photograph at a random scale and place, and mirror it half the time."""
    (height, width), (down, across) = picture.shape[:2], size
    widest = min(width, height * across / down)
    wide = widest * float(np.exp(rng.uniform(np.log(0.3), 0)))
    high = wide * down / across
    x, y = int(rng.uniform(0, width - wide)), int(rng.uniform(0, height - high))
    part = picture[y : y + max(1, round(high)), x : x + max(1, round(wide))]
    seen = cv2.resize(part, (across, down), interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(seen[:, ::-1] if rng.random() < 0.5 else seen)
