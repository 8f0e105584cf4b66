"""What an object looks like: materials over regions of its surface that know nothing of its parts, in one texture image.

Look "plain" is one material everywhere. Look "mixed" cuts the surface along one or two random level sets (planes across the
long axis, slanting planes, bands, balls, waves of noise), which makes two to four regions, and gives each a material. Parts
are no input: the same surface gets the same bytes whatever it is called.

The texture is an atlas of square tiles, one per material. Each face is projected along the axis that it faces most (box
projection); a tile covers the whole object, so that no face leaves its tile.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from afford.render import materials
from afford.synthetic.objects.cut import cut

LOOKS = ("mixed", "plain")
MARGIN = 6
"""Texels between a tile's border and what is mapped into it, so that neighbours do not bleed in."""
AXES = np.array([(1, 2), (0, 2), (0, 1)])
"""The two coordinates that remain when the object is seen along x, y, z."""


@dataclass(frozen=True, eq=False)
class Dressed:
    """A surface with its texture: vertices (v, 3) float64, faces (f, 3) int32, uv (f, 3, 2) float32, texture (a, a, 3) uint8,
    and source (f,) int64, the face of the bare surface that each face is a piece of.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    texture: np.ndarray
    source: np.ndarray


def dressed(vertices: np.ndarray, faces: np.ndarray, look: str, atlas_px: int, rng: np.random.Generator) -> Dressed:
    """The surface in a look, its faces cut where one material ends; ValueError for an unknown look or a size that does not fit."""
    if look not in LOOKS:
        raise ValueError(f"ObjectSpec.look: expected mixed or plain, got {look!r}")
    if atlas_px < 64 or atlas_px & (atlas_px - 1):
        raise ValueError(f"object_build.atlas_px: expected a power of two of at least 64, got {atlas_px}")
    source, region = np.arange(len(faces)), np.zeros(len(faces), np.int64)
    for _ in range(int(rng.integers(1, 3)) if look == "mixed" else 0):
        vertices, faces, piece, side = cut(vertices, faces, level(vertices, rng))
        source, region = source[piece], 2 * region[piece] + side
    tile = np.unique(region, return_inverse=True)[1].reshape(-1)
    across = 1 if tile.max() == 0 else 2
    uv = _uv(vertices, faces, tile, across, atlas_px)
    return Dressed(vertices, faces, uv, _atlas(rng, int(tile.max()) + 1, across, atlas_px), source)


def level(vertices: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(v,) values of a random smooth function of place; a region ends where it is zero."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    size, long = high - low, int(np.argmax(high - low))
    at = (vertices - low) / size.max()
    kind, middle = int(rng.integers(5)), rng.uniform(0.2, 0.8)
    if kind == 0:  # a plane across the long axis
        return at[:, long] - middle * size[long] / size.max()
    if kind == 1:  # a slanting plane
        normal = rng.normal(size=3)
        along = at @ (normal / np.linalg.norm(normal))
        return along - np.quantile(along, middle)
    if kind == 2:  # a band across the long axis
        return np.abs(at[:, long] - middle * size[long] / size.max()) - rng.uniform(0.06, 0.18)
    if kind == 3:  # a ball about a place on the surface
        far = np.linalg.norm(at - at[rng.integers(len(at))], axis=1)
        return far - rng.uniform(0.12, 0.4)
    waves = rng.normal(size=(4, 3)) * 5.0
    noise = np.sin(at @ waves.T + rng.uniform(0, 2 * np.pi, 4)).sum(axis=1)
    return noise - np.quantile(noise, middle)


def _uv(vertices: np.ndarray, faces: np.ndarray, tile: np.ndarray, across: int, atlas_px: int) -> np.ndarray:
    """(f, 3, 2) float32: box projection into the tile of each face, v upwards."""
    tri = vertices[faces]
    normal = np.abs(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]))
    seen = AXES[normal.argmax(axis=1)]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    unit = 0.5 + (tri - (low + high) / 2) / (high - low).max()
    flat = np.take_along_axis(unit, np.repeat(seen[:, None], 3, axis=1), axis=2)
    inset = MARGIN * across / atlas_px
    corner = np.stack([tile % across, tile // across], axis=-1)[:, None]
    return ((corner + inset + (1 - 2 * inset) * flat) / across).astype(np.float32)


def _atlas(rng: np.random.Generator, tiles: int, across: int, atlas_px: int) -> np.ndarray:
    """(atlas_px, atlas_px, 3) uint8: a material in every tile; tile 0 is at the lower left, where u = v = 0."""
    side = atlas_px // across
    atlas = np.zeros((atlas_px, atlas_px, 3), np.uint8)
    for k in range(tiles):
        row, column = across - 1 - k // across, k % across
        atlas[row * side : (row + 1) * side, column * side : (column + 1) * side] = _swatch(rng, side)
    return atlas


def _swatch(rng: np.random.Generator, side: int) -> np.ndarray:
    """(side, side, 3) uint8 of one kind of surface, turned either way."""
    kinds = (materials.wood, materials.metal, materials.plastic, materials.rubber, materials.ceramic, materials.leather)
    made = kinds[int(rng.integers(len(kinds)))](rng).image
    return np.rot90(cv2.resize(made, (side, side), interpolation=cv2.INTER_AREA), int(rng.integers(2)))
