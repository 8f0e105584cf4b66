"""Flat things under the action that give the table a pattern: tea towel, placemat, printed sheets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from afford.render import materials
from afford.render.motion import about, pose
from afford.render.scene import Instance, Material
from afford.render.solids import box

THICKNESS_M = 0.0012
CONTRAST = 0.95
"""of a pattern, relative to new"""
Weave = Callable[[np.random.Generator], Material]
KINDS: dict[str, tuple[Weave, ...]] = {
    "kitchen": (materials.ceramic, materials.ceramic, materials.carton),
    "workshop": (materials.paper, materials.carton),
    "desk": (materials.paper, materials.carton, materials.ceramic),
}


def mats(setting: str, rng: np.random.Generator, centre: np.ndarray) -> list[Instance]:
    """Two flat things around `centre` (2,) on the table, metres."""
    return [_mat(rng, KINDS[setting], centre, level) for level in range(2)]


def _mat(rng: np.random.Generator, kinds: tuple[Weave, ...], centre: np.ndarray, level: int) -> Instance:
    size = (float(rng.uniform(0.40, 0.60)), float(rng.uniform(0.30, 0.42)), THICKNESS_M * (1 + 0.6 * level))
    sheet = box(size, 0.0003, uv_per_m=float(rng.uniform(1.7, 2.8)))
    sheet = replace(sheet, uv=sheet.uv * np.array([1, -1], np.float32))
    x, y = centre + rng.uniform(-0.08, 0.08, 2) + (0.22 * level * rng.choice([-1, 1]), -0.04)
    lying = pose((x, y, 0.0), about((0, 0, 1), rng.uniform(-0.5, 0.5)))
    return Instance(sheet, _washed(kinds[rng.integers(len(kinds))](rng)), lying, casts=False)


def _washed(fresh: Material) -> Material:
    """The same pattern with less contrast: cloth and print that have been used, not a poster."""
    mean = fresh.image.mean(axis=(0, 1))
    return replace(fresh, image=(mean + CONTRAST * (fresh.image - mean)).astype(np.uint8))
