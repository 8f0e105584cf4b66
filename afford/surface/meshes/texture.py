"""A texture for a mesh without one: a material for each region of its surface, baked."""

from __future__ import annotations

import numpy as np

from afford.surface.meshes.bake import bake_texture
from afford.surface.meshes.charts import unwrap
from afford.surface.meshes.materials import CERAMIC, METAL, PLASTIC, RUBBER, WOOD, material_colours
from afford.surface.meshes.regions import main_axis, shape_regions

THIN = METAL
DARK = (WOOD, RUBBER, PLASTIC)
"""what stands out against metal"""


def paint_regions(vertices: np.ndarray, faces: np.ndarray, most: int, side: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates (f, 3, 2) float32 and image (side, side, 3) uint8 for (v, 3) vertices in metres and (f, 3) faces, with at most
    `most` materials. The thinnest of several regions looks like metal, the others like what `seed` draws.
    """
    region, _ = shape_regions(vertices, faces, most)
    kinds = _kinds(int(region.max()) + 1, np.random.default_rng(seed))
    tri, (middle, axes) = vertices.astype(np.float64)[faces], main_axis(vertices.astype(np.float64), faces)

    def colour_at(face: np.ndarray, bary: np.ndarray) -> np.ndarray:
        points = (np.einsum("nk,nkc->nc", bary, tri[face]) - middle) @ axes.T
        out = np.zeros((len(face), 3), np.uint8)
        for number, kind in enumerate(kinds):
            mine = region[face] == number
            out[mine] = material_colours(kind, points[mine], np.random.default_rng((seed, number)))
        return out

    uv = unwrap(vertices, faces, side)
    return uv, bake_texture(uv, side, colour_at)


def _kinds(count: int, rng: np.random.Generator) -> list[int]:
    """A material for each region, thinnest first; no two the same as long as there are enough."""
    dark = [int(kind) for kind in rng.permutation(DARK)]
    chosen = [THIN, *dark, CERAMIC] if count > 1 else [*dark, CERAMIC]
    return [chosen[k % len(chosen)] for k in range(count)]
