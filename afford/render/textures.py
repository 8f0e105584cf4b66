"""All images of a scene in one flat array with their mip levels, so that one kernel can read any of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from afford.render.model import Material

GAMMA = 2.2


@dataclass(frozen=True, eq=False)
class Textures:
    """A pool of mip-mapped images. `texels` (n, 3) uint8: 255 x the square root of linear RGB; `levels` (images, levels, 3)
    int64: offset, height, width of each level; `layer` finds an image by identity (the pool keeps the images alive).
    """

    texels: np.ndarray
    levels: np.ndarray
    layer: dict[int, int]
    images: tuple[np.ndarray, ...]

    @staticmethod
    def of(materials: Iterable[Material]) -> Textures:
        """The pool of the images that these materials use. ValueError when a side is not a power of two."""
        unique = {id(m.image): m.image for m in materials}
        for image in unique.values():
            if any(side & (side - 1) for side in image.shape[:2]):
                raise ValueError(f"Material.image: expected sides that are powers of two, got {image.shape[:2]}; resize it")
        images = tuple(unique.values())
        pyramids = [_pyramid(image) for image in images]
        depth = max(len(p) for p in pyramids)
        levels = np.zeros((len(images), depth, 3), np.int64)
        offset = 0
        for row, pyramid in zip(levels, pyramids, strict=True):
            for k in range(depth):
                level = pyramid[min(k, len(pyramid) - 1)]
                row[k] = (offset if k < len(pyramid) else row[k - 1, 0], *level.shape[:2])
                offset += level.shape[0] * level.shape[1] if k < len(pyramid) else 0
        texels = np.concatenate([_roots(level).reshape(-1, 3) for pyramid in pyramids for level in pyramid])
        return Textures(texels, levels, {key: k for k, key in enumerate(unique)}, images)


def linear(image: np.ndarray) -> np.ndarray:
    """(h, w, 3) uint8 sRGB to float32 linear 0..1."""
    return ((np.arange(256) / 255.0) ** GAMMA).astype(np.float32)[image]


def _roots(level: np.ndarray) -> np.ndarray:
    return (np.sqrt(level) * np.float32(255) + np.float32(0.5)).astype(np.uint8)


def _pyramid(image: np.ndarray) -> list[np.ndarray]:
    level = linear(image)
    out = [level]
    while min(level.shape[:2]) > 1:
        h, w = level.shape[0] // 2 * 2, level.shape[1] // 2 * 2
        level = level[:h, :w].reshape(h // 2, 2, w // 2, 2, 3).mean(axis=(1, 3), dtype=np.float32)
        out.append(np.ascontiguousarray(level))
    return out
