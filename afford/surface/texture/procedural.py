"""Procedural materials by shape: thin regions of the surface look like metal, thick ones like handles.

Materials are functions of 3-D position, so that they continue across texture seams. Points are (n, 3) in metres; the first axis is
the long axis of the object, along which wood grows and metal is brushed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from afford.surface.meshes.charts import unwrap
from afford.surface.meshes.texture import bake_texture
from afford.surface.texture import Procedural
from afford.surface.texture.shape_regions import main_axis, shape_regions
from schemas.mesh import ObjectMesh

WAVES = 7
METAL, WOOD, RUBBER, PLASTIC, CERAMIC = range(5)


def material_colours(kind: int, points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Compute the colours (n, 3) uint8 sRGB of a material at points."""
    rgb = (_metal, _wood, _rubber, _plastic, _ceramic)[kind](points, rng)
    return np.clip(rgb + rng.normal(0, 1.5, (len(points), 1)), 0, 255).astype(np.uint8)


def wave_noise(points: np.ndarray, rng: np.random.Generator, scale_m: float) -> np.ndarray:
    """Smooth noise (n,) from random plane waves, mean 0, about -1..1, with features of `scale_m` and finer."""
    out = np.zeros(len(points))
    for octave in range(3):
        k = rng.normal(size=(WAVES, 3)) * 2**octave / scale_m
        waves = np.cos(points @ k.T + rng.uniform(0, 2 * np.pi, WAVES))
        out += waves.sum(axis=1) / np.sqrt(WAVES / 2) / 2**octave
    return out / 2


def _metal(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    brushed = wave_noise(points * [0.05, 1, 1], rng, 0.0012)
    return np.array([188, 192, 198]) + (9 * brushed + 8 * wave_noise(points, rng, 0.03))[:, None]


def _wood(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    middle = rng.uniform(0.02, 0.05, 2)
    radius = np.hypot(points[:, 1] - middle[0], points[:, 2] - middle[1]) + 0.003 * wave_noise(points * [0.15, 1, 1], rng, 0.02)
    rings = (0.5 + 0.5 * np.cos(2 * np.pi * radius / 0.004)) ** 1.5
    fibre = wave_noise(points * [0.06, 1, 1], rng, 0.0015)
    light, dark = np.array([[178, 126, 78], [112, 70, 42]])[:, :] * rng.uniform(0.8, 1.1)
    return light + (dark - light) * np.clip(0.75 * rings + 0.18 * fibre + 0.1, 0, 1)[:, None]


def _rubber(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.array([46, 46, 50]) + (5 * wave_noise(points, rng, 0.004) + 3 * wave_noise(points, rng, 0.03))[:, None]


def _plastic(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    tone = np.array([(176, 44, 38), (36, 84, 150), (214, 168, 40), (52, 116, 70)][rng.integers(4)])
    return tone + (4 * wave_noise(points, rng, 0.02))[:, None]


def _ceramic(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.array([226, 220, 206]) + (5 * wave_noise(points, rng, 0.03))[:, None]


THIN = METAL
DARK = (WOOD, RUBBER, PLASTIC)
"""materials that contrast with metal"""


def paint_regions(vertices: np.ndarray, faces: np.ndarray, most: int, side: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Texture (v, 3) vertices in metres and (f, 3) faces with at most `most` materials.

    Returns coordinates (f, 3, 2) float32 and an image (side, side, 3) uint8. The thinnest of several regions is metal; `seed`
    selects the other materials.
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
    """Choose a material for each region, thinnest first; materials repeat only when there are too few."""
    dark = [int(kind) for kind in rng.permutation(DARK)]
    chosen = [THIN, *dark, CERAMIC] if count > 1 else [*dark, CERAMIC]
    return [chosen[k % len(chosen)] for k in range(count)]


def texture(mesh: ObjectMesh, params: Procedural) -> ObjectMesh:
    """Paint a material on each shape region of the surface: metal on thin regions, other materials on thick ones."""
    uv, image = paint_regions(mesh.vertices, mesh.faces, params.regions, params.side_px, params.seed)
    return replace(mesh, uv=uv, texture=image)


def keep(mesh: ObjectMesh, params: None) -> ObjectMesh:
    """Keep the one colour."""
    return mesh
