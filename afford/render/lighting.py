"""The lamps of a frame with their shadow maps, with and without hands, and which pixels the hands' shadows can reach."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from afford.render.batch import Batch
from afford.render.model import Camera, Light
from afford.render.shadow import FAR, SIZE, Lamp, depth_maps, lamps, reach

CELL = 8
"""Shadow maps are compared in cells of this many texels."""


@dataclass(frozen=True, eq=False)
class Lighting:
    """Lamps and ambience as the kernel wants them; `full` and `bare` (lamps, SIZE, SIZE) are the depth maps with and without
    the entities that were named last.
    """

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
        full = np.full((len(both), SIZE, SIZE), FAR, np.float32)
        bare = full.copy() if last else full
        for lamp, all_, some in zip(both, full, bare, strict=True):
            depth_maps(scene, lamp, last, all_, some)
        return Lighting(both, np.array(rows, np.float32), ambience, light.vignette, full, bare)

    def touched(self, camera: Camera, depth_m: np.ndarray) -> np.ndarray:
        """(h, w) bool: the pixels, seen at these depths (h, w), whose light may differ between the two sets of maps."""
        out = np.zeros(depth_m.shape, np.bool_)
        for lamp, full, bare in zip(self.lamps, self.full, self.bare, strict=True):
            cells = (full != bare).reshape(SIZE // CELL, CELL, SIZE // CELL, CELL).any(axis=(1, 3)).astype(np.uint8)
            around = 2 * (int(np.ceil((reach(lamp) + 4) / CELL)) + 1) + 1
            near = cv2.dilate(cells, np.ones((around, around), np.uint8))
            column, row = (
                np.clip(texel / CELL, 0, SIZE // CELL - 1).astype(np.int32) for texel in _texels(lamp, camera, depth_m)
            )
            out |= near[row, column] > 0
        return out


def _texels(lamp: Lamp, camera: Camera, depth_m: np.ndarray) -> list[np.ndarray]:
    """Shadow map x and y, each (h, w), of what is seen at these depths."""
    rays = lamp.frame[:2, :3] @ camera.T_world_cam[:3, :3] @ np.linalg.inv(camera.K)
    start = lamp.frame[:2, :3] @ camera.T_world_cam[:3, 3] + lamp.frame[:2, 3]
    y, x = np.ogrid[0 : camera.height, 0 : camera.width]
    return [
        depth_m * (ray[0] * x + ray[1] * y + ray[2]).astype(np.float32) + np.float32(s)
        for ray, s in zip(rays, start, strict=True)
    ]
