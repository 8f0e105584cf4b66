"""Texture of an object: materials over regions of its surface that are independent of its parts, in one atlas image.

Look "plain" is one material. Look "mixed" cuts the surface along one or two random level sets (planes across the long axis,
slanted planes, bands, balls, noise), which gives two to four regions, each with its own material. Parts are not an input: the
same surface gets the same bytes whatever its labels.

The atlas consists of square tiles, one per material. Each face is projected along its dominant axis (box projection). A tile
covers the whole object, so that no face leaves its tile.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from afford.render import materials

NEAR = 0.12
"""Minimum distance of a cut from the ends of an edge, as a share of its length, which avoids slivers."""


def cut_by_level(
    vertices: np.ndarray, faces: np.ndarray, value: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Cut a triangle mesh along the zero level set of `value` (v,), so that every face lies on one side.

    Returns vertices with the added ones, faces int32, the source face of each new face, and its side: 1 where the value is
    positive or zero, else 0. A closed surface stays closed.
    """
    side = np.asarray(value) >= 0
    lone = _lone_corner(side[faces])
    crossed = np.flatnonzero(lone >= 0)
    if not len(crossed):
        return vertices, np.asarray(faces, np.int32), np.arange(len(faces)), side[faces[:, 0]].astype(np.int64)
    turned = np.take_along_axis(faces[crossed], (lone[crossed, None] + np.arange(3)) % 3, axis=1)
    a, b, c = turned.T
    points, (ab, ac) = _midpoints(vertices, value, np.stack([np.stack([a, b], -1), np.stack([a, c], -1)]))
    pieces = np.concatenate([np.stack(corner, -1) for corner in ((a, ab, ac), (ab, b, c), (ab, c, ac))])
    whole = np.flatnonzero(lone < 0)
    out_side = np.concatenate([side[faces[whole, 0]], side[a], side[b], side[b]]).astype(np.int64)
    order = np.argsort(source := np.concatenate([whole, crossed, crossed, crossed]), kind="stable")
    return points, np.concatenate([faces[whole], pieces])[order].astype(np.int32), source[order], out_side[order]


def _lone_corner(side: np.ndarray) -> np.ndarray:
    """Return the corner (f,) that is alone on its side, -1 where all three agree."""
    count = side.sum(axis=1)
    alone = np.where((count == 1)[:, None], side, ~side).argmax(axis=1)
    return np.where((count == 1) | (count == 2), alone, -1)


def _midpoints(vertices: np.ndarray, value: np.ndarray, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Add one point for every crossed edge of `edges` (2, n, 2); return all vertices and the indices (2, n) of the new points."""
    ends, index = np.unique(np.sort(edges.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    start, stop = ends.T
    share = np.clip(value[start] / (value[start] - value[stop]), NEAR, 1 - NEAR)[:, None]
    new = vertices[start] * (1 - share) + vertices[stop] * share
    return np.concatenate([vertices, new]), len(vertices) + index.reshape(edges.shape[:2])


LOOKS = ("mixed", "plain")
MARGIN = 6
"""Margin in texels between the border of a tile and the mapped area, so that neighbouring tiles do not bleed in."""
AXES = np.array([(1, 2), (0, 2), (0, 1)])
"""Coordinates that remain when the object is projected along x, y, z."""


@dataclass(frozen=True, eq=False)
class TexturedSurface:
    """Textured surface.

    vertices (v, 3) float64, faces (f, 3) int32, uv (f, 3, 2) float32, texture (a, a, 3) uint8, and source (f,) int64, the face
    of the original surface that each face is cut from.
    """

    vertices: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    texture: np.ndarray
    source: np.ndarray


def texture_surface(vertices: np.ndarray, faces: np.ndarray, look: str, atlas_px: int, rng: np.random.Generator) -> TexturedSurface:
    """Texture a surface in a look, with its faces cut at material boundaries.

    Raises ValueError for an unknown look or an atlas size that is not a power of two of at least 64.
    """
    if look not in LOOKS:
        raise ValueError(f"ObjectSpec.look: expected mixed or plain, got {look!r}")
    if atlas_px < 64 or atlas_px & (atlas_px - 1):
        raise ValueError(f"object_build.atlas_px: expected a power of two of at least 64, got {atlas_px}")
    source, region = np.arange(len(faces)), np.zeros(len(faces), np.int64)
    for _ in range(int(rng.integers(1, 3)) if look == "mixed" else 0):
        vertices, faces, piece, side = cut_by_level(vertices, faces, random_level_set(vertices, rng))
        source, region = source[piece], 2 * region[piece] + side
    tile = np.unique(region, return_inverse=True)[1].reshape(-1)
    across = 1 if tile.max() == 0 else 2
    uv = _uv(vertices, faces, tile, across, atlas_px)
    return TexturedSurface(vertices, faces, uv, _atlas(rng, int(tile.max()) + 1, across, atlas_px), source)


def random_level_set(vertices: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return the values (v,) of a random smooth function on the surface; a region ends where it is zero."""
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
    """Return the box projection (f, 3, 2) float32 of each face into its tile, v upwards."""
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
    """Return the atlas (atlas_px, atlas_px, 3) uint8 with a material in every tile; tile 0 is at the lower left, u = v = 0."""
    side = atlas_px // across
    atlas = np.zeros((atlas_px, atlas_px, 3), np.uint8)
    for k in range(tiles):
        row, column = across - 1 - k // across, k % across
        atlas[row * side : (row + 1) * side, column * side : (column + 1) * side] = _swatch(rng, side)
    return atlas


def _swatch(rng: np.random.Generator, side: int) -> np.ndarray:
    """Return a patch (side, side, 3) uint8 of a random material, rotated by 0 or 90 degrees."""
    kinds = (materials.wood, materials.metal, materials.plastic, materials.rubber, materials.ceramic, materials.leather)
    made = kinds[int(rng.integers(len(kinds)))](rng).image
    return np.rot90(cv2.resize(made, (side, side), interpolation=cv2.INTER_AREA), int(rng.integers(2)))
