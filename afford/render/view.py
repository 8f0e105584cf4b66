"""A scene seen by a camera, with some entities drawn last: what is seen with them and without them costs one pass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.render.batch import Batch
from afford.render.model import BACKGROUND, Camera
from afford.render.raster import edges, fill, project

Seen = tuple[np.ndarray, np.ndarray]
"""Triangle index (int32, -1 none) and 1 / depth (float32) of every sample."""


@dataclass(frozen=True, eq=False)
class View:
    """A batch seen by a camera: edge matrices and pixel boxes of its triangles, and the faces of each part."""

    scene: Batch
    camera: Camera
    E: np.ndarray
    bounds: np.ndarray
    starts: np.ndarray

    @staticmethod
    def of(scene: Batch, camera: Camera) -> View:
        """Project every triangle once."""
        E, bounds = edges(project(scene.vertices, camera), scene.faces, camera.width, camera.height)
        return View(scene, camera, E, bounds, np.searchsorted(scene.part, np.arange(len(scene.entity) + 1)))

    def seen(self, supersample: int, last: frozenset[int] = frozenset()) -> tuple[Seen, Seen]:
        """What is seen without the entities in `last`, and with everything."""
        shape = (self.camera.height * supersample, self.camera.width * supersample)
        near, face = np.zeros(shape, np.float32), np.full(shape, -1, np.int32)
        late = np.isin(self.scene.entity, list(last))
        self._draw(np.flatnonzero(~late), supersample, near, face)
        if not late.any():
            return (face, near), (face, near)
        without = (face.copy(), near.copy())
        self._draw(np.flatnonzero(late), supersample, near, face)
        return without, (face, near)

    def alone(self, entity: int) -> np.ndarray:
        """(h, w) bool: every pixel of one entity, whatever stands before it."""
        near = np.zeros((self.camera.height, self.camera.width), np.float32)
        face = np.full(near.shape, -1, np.int32)
        self._draw(np.flatnonzero(self.scene.entity == entity), 1, near, face)
        return face >= 0

    def ids(self, face: np.ndarray) -> np.ndarray:
        """(h, w) int16 entity of each triangle index."""
        return np.append(self.scene.entity[self.scene.part], np.int16(BACKGROUND))[face]

    def _draw(self, parts: np.ndarray, supersample: int, near: np.ndarray, face: np.ndarray) -> None:
        for k in parts:
            fill(self.E, self.bounds, self.starts[k], self.starts[k + 1], supersample, near, face)


def depth(near: np.ndarray) -> np.ndarray:
    """Depth in metres of 1 / depth; 0 where nothing is."""
    return np.where(near > 0, 1.0 / np.maximum(near, 1e-9), 0.0).astype(np.float32)
