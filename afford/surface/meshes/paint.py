"""One texture for a repaired mesh: images packed as they are, or, where faces are new or corners coloured, painted anew."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from afford.surface.meshes.atlas import pack_atlas
from afford.surface.meshes.bake import bake_texture, sample_texture
from afford.surface.meshes.charts import unwrap
from afford.surface.meshes.surface import Surface

FLAT_COLOURS = 256
"""a mesh of at most so many face colours gets a palette, not a painting"""
BAKED_PX = 1024


@dataclass(frozen=True, eq=False)
class FaceColours:
    """The colours of triangles: one texture, or corner colours where there is none."""

    uv: np.ndarray
    """(f, 3, 2) float32"""
    texture: np.ndarray
    """(h, w, 3) uint8"""
    colour: np.ndarray
    """(f, 3, 3) uint8"""
    cornered: np.ndarray
    """(f,) bool: faces that have corner colours"""

    def at(self, face: np.ndarray, bary: np.ndarray) -> np.ndarray:
        """(n, 3) uint8 colours of places on faces."""
        out = sample_texture(self.texture, np.einsum("nk,nkc->nc", bary, self.uv[face]))
        mixed = np.round(np.einsum("nk,nkc->nc", bary, self.colour[face].astype(np.float64))).astype(np.uint8)
        return np.where(self.cornered[face][:, None], mixed, out)


def face_colours(surface: Surface, corner: np.ndarray, limit: int) -> tuple[FaceColours, int]:
    """Colours of the faces whose corners come from `corner` (f, 3) of a surface, and how often images were halved."""
    flat = _palette(surface)
    uv = flat.uv.reshape(-1, 2)[corner]
    paint = flat.paint[corner[:, 0] // 3]
    colour = flat.colour.reshape(-1, 3)[corner]
    cornered = paint < 0
    images = flat.images or (np.zeros((1, 1, 3), np.uint8),)
    texture, packed, halved = pack_atlas(images, uv, np.maximum(paint, 0), limit)
    return FaceColours(packed, texture, colour, cornered), halved


def bake_colours(vertices: np.ndarray, faces: np.ndarray, seen: FaceColours, limit: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and texture of a mesh that has the faces of its look."""
    if not seen.cornered.any():
        return seen.uv, seen.texture
    uv = unwrap(vertices, faces, min(limit, BAKED_PX))
    return uv, bake_texture(uv, min(limit, BAKED_PX), seen.at)


def _palette(surface: Surface) -> Surface:
    """Corner colours turned into plain materials, where each face has one colour and there are few."""
    mine = surface.paint < 0
    flat = (surface.colour[mine] == surface.colour[mine][:, :1]).all()
    colours, index = np.unique(surface.colour[mine][:, 0], axis=0, return_inverse=True)
    if not mine.any() or not flat or len(colours) > FLAT_COLOURS:
        return surface
    paint = surface.paint.copy()
    paint[mine] = len(surface.images) + index.reshape(-1)
    return replace(surface, paint=paint, images=surface.images + tuple(c.reshape(1, 1, 3) for c in colours))
