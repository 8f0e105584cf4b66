"""The lamps of a frame with their shadow maps, with and without hands, and which pixels the hands' shadows can reach."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from afford.render.batch import Batch
from afford.render.model import Light
from afford.render.shadow import SIZE, Lamp, depth_maps, lamps, reach

CELL = 8
"""Shadow maps are compared in cells of this many texels."""


@dataclass(frozen=True, eq=False)
class Lighting:
    """Lamps and ambience as the kernel wants them; `full` and `bare` (lamps, SIZE, SIZE) are the depth maps with and without
    the entities that were named last."""

    lamps: tuple[Lamp, ...]
    rows: np.ndarray
    ambience: np.ndarray
    vignette: float
    full: np.ndarray
    bare: np.ndarray

    @staticmethod
    def of(scene: Batch, light: Light, last: frozenset[int] = frozenset()) -> Lighting:
        """Draw the shadow maps of a scene."""
        both = tuple(lamps(light))
        rows = [np.concatenate([la.frame.reshape(-1), -la.frame[2, :3], la.colour, [la.softness, la.texel_m]]) for la in both]
        ambience = np.array([light.sky, light.ground, [light.exposure] * 3], np.float32)
        maps = [depth_maps(scene, lamp, last) for lamp in both]
        return Lighting(
            both,
            np.array(rows, np.float32),
            ambience,
            light.vignette,
            np.stack([m[1] for m in maps]),
            np.stack([m[0] for m in maps]),
        )

    def touched(self, points: np.ndarray) -> np.ndarray:
        """(h, w) bool: the points (h, w, 3) whose light may differ between the two sets of maps."""
        out = np.zeros(points.shape[:2], np.bool_)
        for lamp, full, bare in zip(self.lamps, self.full, self.bare, strict=True):
            cells = (full != bare).reshape(SIZE // CELL, CELL, SIZE // CELL, CELL).any(axis=(1, 3)).astype(np.uint8)
            around = 2 * (int(np.ceil((reach(lamp) + 4) / CELL)) + 1) + 1
            near = cv2.dilate(cells, np.ones((around, around), np.uint8))
            where = points @ lamp.frame[:2, :3].T + lamp.frame[:2, 3]
            cell = np.clip((where / CELL).astype(np.int32), 0, SIZE // CELL - 1)
            out |= near[cell[..., 1], cell[..., 0]] > 0
        return out
