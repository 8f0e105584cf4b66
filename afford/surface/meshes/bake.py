"""A texture painted point by point, and read again."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np

from afford.common.masks import fill_nearest

ColourAt = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""faces (n,) int64 and barycentric coordinates (n, 3) float64 -> (n, 3) uint8 sRGB"""


def bake(uv: np.ndarray, side: int, colour_at: ColourAt) -> np.ndarray:
    """(side, side, 3) uint8 texture; texels of no face take the colour of the nearest face in the texture."""
    face, bary = rasterise(np.ascontiguousarray(uv, np.float64), side)
    inside = face >= 0
    out = np.zeros((side, side, 3), np.uint8)
    out[inside] = colour_at(face[inside].astype(np.int64), bary[inside])
    return fill_nearest(out, inside)


@numba.njit(cache=True)
def rasterise(uv, side):  # type: ignore[no-untyped-def]  # numba infers
    """(side, side) int32 face at each texel centre (-1 none; a texel that only the edge of a face touches counts) and
    (side, side, 3) float64 barycentric coordinates.
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


def sample(texture: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(n, 3) uint8 colours of a texture at (n, 2) coordinates, blended between texels; it repeats beyond 0..1."""
    height, width = texture.shape[:2]
    x, y = uv[:, 0] * width - 0.5, (1 - uv[:, 1]) * height - 0.5
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    fx, fy = (x - left)[:, None], (y - top)[:, None]
    at = [texture[(top + dy) % height, (left + dx) % width] for dy in (0, 1) for dx in (0, 1)]
    mixed = (at[0] * (1 - fx) + at[1] * fx) * (1 - fy) + (at[2] * (1 - fx) + at[3] * fx) * fy
    return np.round(mixed).astype(np.uint8)
