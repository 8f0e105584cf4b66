"""Texture of a repaired mesh: images packed into an atlas, or colours baked into a new texture.

Images keep their texels as long as they fit. Texel (row, column) of an (h, w) image has its centre at u = (column + 0.5) / w, v = 1
- (row + 0.5) / h.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numba
import numpy as np

from afford.common.masks import fill_nearest
from afford.surface.meshes.charts import unwrap
from afford.surface.meshes.net import MeshError
from afford.surface.meshes.surface import Surface

BORDER = 8
"""texels around a tile that repeat the image"""
SLACK = 1e-4
"""tolerance of coordinates outside 0..1"""
REPEATS = 16
"""largest number of repeats of an image along a side"""


def pack_atlas(images: tuple[np.ndarray, ...], uv: np.ndarray, paint: np.ndarray, limit: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Pack images into one texture (h, w, 3) uint8 with sides that are powers of two up to `limit`.

    Also returns coordinates (f, 3, 2) float32 in the texture, and how often the images were halved to fit. Raises MeshError when
    they cannot fit.
    """
    unique, paint = _unique(images, paint)
    uv = np.where((np.array([image.size for image in unique]) > 3)[paint][:, None, None], uv, 0.5)
    uv, repeats = _settled(uv, paint, len(unique))
    if len(unique) == 1 and (repeats == 1).all() and _fits(unique[0], limit):
        return unique[0], np.clip(uv, 0, 1).astype(np.float32), 0
    if repeats.max() > REPEATS:
        raise MeshError(f"an image that repeats at most {REPEATS} times along a side", str(repeats.max()),
                    "bake the texture into one image before exporting")
    tiles = [np.tile(image, (ry, rx, 1)) for image, (rx, ry) in zip(unique, repeats, strict=True)]
    halved = 0
    while (placed := _place(tiles, limit)) is None:
        if max(max(tile.shape[:2]) for tile in tiles) <= 1:
            raise MeshError(f"materials that fit into {limit} x {limit} texels", str(len(tiles)), "raise max_texture_px")
        tiles, halved = [_half(tile) for tile in tiles], halved + 1
    height, width, corners = placed
    texture = np.zeros((height, width, 3), np.uint8)
    for tile, (x, y) in zip(tiles, corners, strict=True):
        bordered = np.pad(tile, ((BORDER, BORDER), (BORDER, BORDER), (0, 0)), mode="wrap")
        texture[y : y + len(bordered), x : x + bordered.shape[1]] = bordered
    size = np.array([tile.shape[1::-1] for tile in tiles], np.float64)
    low = np.array([(x + BORDER, height - y - BORDER) for x, y in corners], np.float64) - size * [0, 1]
    out = (low[paint][:, None] + uv / repeats[paint][:, None] * size[paint][:, None]) / [width, height]
    return texture, out.astype(np.float32), halved


def _unique(images: tuple[np.ndarray, ...], paint: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the distinct images in use, and the index of each face's image."""
    found: dict[tuple[tuple[int, ...], bytes], int] = {}
    used = np.unique(paint)
    index = np.zeros(len(images), np.int64)
    for k in used:
        index[k] = found.setdefault((images[k].shape, images[k].tobytes()), len(found))
    return [images[next(k for k in used if index[k] == n)] for n in range(len(found))], index[paint]


def _settled(uv: np.ndarray, paint: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Shift coordinates by whole repeats to start in 0..1, and return the number of repeats (count, 2)."""
    uv = uv - np.floor(uv.min(axis=1, keepdims=True) + SLACK)
    reach = np.ones((count, 2), np.int64)
    np.maximum.at(reach, paint, np.ceil(uv.max(axis=1) - SLACK).astype(np.int64))
    return np.clip(uv, 0, reach[paint][:, None]), reach


def _fits(image: np.ndarray, limit: int) -> bool:
    return all(side <= limit and side & (side - 1) == 0 for side in image.shape[:2])


def _half(tile: np.ndarray) -> np.ndarray:
    if max(tile.shape[:2]) <= 1:
        return tile
    return cv2.resize(tile, (max(tile.shape[1] // 2, 1), max(tile.shape[0] // 2, 1)), interpolation=cv2.INTER_AREA)


def _place(tiles: list[np.ndarray], limit: int) -> tuple[int, int, list[tuple[int, int]]] | None:
    """Find the smallest texture for the tiles on shelves: height, width and corners, or None."""
    sizes = [(tile.shape[1] + 2 * BORDER, tile.shape[0] + 2 * BORDER) for tile in tiles]
    order = sorted(range(len(sizes)), key=lambda k: (-sizes[k][1], -sizes[k][0], k))
    best = None
    for width in (1 << k for k in range(limit.bit_length())):
        corners, height = _shelves(sizes, order, width)
        tall = 1 << max(height - 1, 0).bit_length()
        if corners and tall <= limit and (best is None or (width * tall, abs(width - tall)) < best[0]):
            best = ((width * tall, abs(width - tall)), tall, width, corners)
    return None if best is None else best[1:]


def _shelves(sizes: list[tuple[int, int]], order: list[int], width: int) -> tuple[list[tuple[int, int]], int]:
    """Pack tiles row by row, tallest first: corners and total height; no corners if one is too wide."""
    corners, x, y, shelf = [(0, 0)] * len(sizes), 0, 0, 0
    for k in order:
        w, h = sizes[k]
        if w > width:
            return [], 0
        if x + w > width:
            x, y, shelf = 0, y + shelf, 0
        corners[k] = (x, y)
        x, shelf = x + w, max(shelf, h)
    return corners, y + shelf


ColourAt = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""faces (n,) int64 and barycentric coordinates (n, 3) float64 -> (n, 3) uint8 sRGB"""


def bake_texture(uv: np.ndarray, side: int, colour_at: ColourAt) -> np.ndarray:
    """Bake colours into a texture (side, side, 3) uint8; unused texels take the colour of the nearest face."""
    face, bary = rasterise(np.ascontiguousarray(uv, np.float64), side)
    inside = face >= 0
    out = np.zeros((side, side, 3), np.uint8)
    out[inside] = colour_at(face[inside].astype(np.int64), bary[inside])
    return fill_nearest(out, inside)


@numba.njit(cache=True)
def rasterise(uv, side):  # type: ignore[no-untyped-def]  # numba infers
    """Find the face (side, side) int32 at each texel centre, and barycentric coordinates (side, side, 3) float64.

    -1 for no face; a texel that only the edge of a face touches counts.
    """
    face = np.full((side, side), -1, np.int32)
    best = np.full((side, side), -1e-3)
    bary = np.zeros((side, side, 3))
    for f in range(len(uv)):
        x, y = uv[f, :, 0] * side - 0.5, (1 - uv[f, :, 1]) * side - 0.5
        area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
        if abs(area) < 1e-12:
            continue
        for row in range(max(0, int(np.floor(y.min()))), min(side, int(np.ceil(y.max())) + 1)):
            for column in range(max(0, int(np.floor(x.min()))), min(side, int(np.ceil(x.max())) + 1)):
                b = ((x[2] - column) * (y[0] - row) - (x[0] - column) * (y[2] - row)) / area
                c = ((x[0] - column) * (y[1] - row) - (x[1] - column) * (y[0] - row)) / area
                a = 1 - b - c
                least = min(a, b, c)
                if least > best[row, column]:
                    best[row, column] = least
                    face[row, column] = f
                    a, b, c = max(a, 0.0), max(b, 0.0), max(c, 0.0)
                    bary[row, column, 0], bary[row, column, 1], bary[row, column, 2] = a, b, c
    return face, bary


def sample_texture(texture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """Sample colours (n, 3) uint8 at coordinates (n, 2), bilinear; the texture repeats beyond 0..1."""
    height, width = texture.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    fx, fy = (x - left)[:, None], (y - top)[:, None]
    at = [texture[(top + dy) % height, (left + dx) % width] for dy in (0, 1) for dx in (0, 1)]
    mixed = (at[0] * (1 - fx) + at[1] * fx) * (1 - fy) + (at[2] * (1 - fx) + at[3] * fx) * fy
    return np.round(mixed).astype(np.uint8)


FLAT_COLOURS = 256
"""largest number of face colours that become plain materials instead of a baked texture"""
BAKED_PX = 1024


@dataclass(frozen=True, eq=False)
class FaceColours:
    """Colours of triangles: one texture, and corner colours of faces without an image."""

    uv: np.ndarray
    """(f, 3, 2) float32"""
    texture: np.ndarray
    """(h, w, 3) uint8"""
    colour: np.ndarray
    """(f, 3, 3) uint8"""
    cornered: np.ndarray
    """(f,) bool: faces with corner colours"""

    def at(self, face: np.ndarray, bary: np.ndarray) -> np.ndarray:
        """Compute the colours (n, 3) uint8 at points on faces."""
        out = sample_texture(self.texture, np.einsum("nk,nkc->nc", bary, self.uv[face]))
        mixed = np.round(np.einsum("nk,nkc->nc", bary, self.colour[face].astype(np.float64))).astype(np.uint8)
        return np.where(self.cornered[face][:, None], mixed, out)


def face_colours(surface: Surface, corner: np.ndarray, limit: int) -> tuple[FaceColours, int]:
    """Collect the colours of faces whose corners come from `corner` (f, 3); count the halvings of images."""
    flat = _palette(surface)
    uv = flat.uv.reshape(-1, 2)[corner]
    paint = flat.paint[corner[:, 0] // 3]
    colour = flat.colour.reshape(-1, 3)[corner]
    cornered = paint < 0
    images = flat.images or (np.zeros((1, 1, 3), np.uint8),)
    texture, packed, halved = pack_atlas(images, uv, np.maximum(paint, 0), limit)
    return FaceColours(packed, texture, colour, cornered), halved


def bake_colours(vertices: np.ndarray, faces: np.ndarray, seen: FaceColours, limit: int) -> tuple[np.ndarray, np.ndarray]:
    """Return coordinates and texture of a mesh with the same faces as `seen`."""
    if not seen.cornered.any():
        return seen.uv, seen.texture
    uv = unwrap(vertices, faces, min(limit, BAKED_PX))
    return uv, bake_texture(uv, min(limit, BAKED_PX), seen.at)


def _palette(surface: Surface) -> Surface:
    """Convert corner colours to plain materials if each face has one colour and there are few."""
    mine = surface.paint < 0
    flat = (surface.colour[mine] == surface.colour[mine][:, :1]).all()
    colours, index = np.unique(surface.colour[mine][:, 0], axis=0, return_inverse=True)
    if not mine.any() or not flat or len(colours) > FLAT_COLOURS:
        return surface
    paint = surface.paint.copy()
    paint[mine] = len(surface.images) + index.reshape(-1)
    return replace(surface, paint=paint, images=surface.images + tuple(c.reshape(1, 1, 3) for c in colours))
