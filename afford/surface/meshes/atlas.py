"""Several images as one texture: packed as tiles with a border, texels untouched as long as they fit.

Texel (row, column) of an (h, w) image has its centre at u = (column + 0.5) / w, v = 1 - (row + 0.5) / h.
"""

from __future__ import annotations

import cv2
import numpy as np

from afford.surface.meshes.errors import MeshError

BORDER = 8
"""texels around a tile that repeat it, as its image did"""
SLACK = 1e-4
"""how far outside an image coordinates may stray and still mean its edge"""
REPEATS = 16
"""an image may be repeated this often along a side"""


def pack_atlas(images: tuple[np.ndarray, ...], uv: np.ndarray, paint: np.ndarray, limit: int) -> tuple[np.ndarray, np.ndarray, int]:
    """One texture (h, w, 3) uint8 with sides that are powers of two up to `limit`, coordinates (f, 3, 2) float32 in it, and
    how often the images had to be halved to fit. MeshError when they cannot fit.
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
    """The images that are used, each once, and the index of each face's."""
    found: dict[tuple[tuple[int, ...], bytes], int] = {}
    used = np.unique(paint)
    index = np.zeros(len(images), np.int64)
    for k in used:
        index[k] = found.setdefault((images[k].shape, images[k].tobytes()), len(found))
    return [images[next(k for k in used if index[k] == n)] for n in range(len(found))], index[paint]


def _settled(uv: np.ndarray, paint: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates moved by whole repeats to start in 0..1, and how far (count, 2) whole repeats reach."""
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
    """Height and width of the smallest texture in which the tiles stand on shelves, and their corners; None if none fits."""
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
    """Corners of the tiles, tallest first, row after row, and the height that takes; no corners when one is too wide."""
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
