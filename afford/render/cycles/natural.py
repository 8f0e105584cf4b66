"""Natural materials for Cycles: photographed surfaces, paler prints, varnish, glass, and other roughness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from afford.render.cycles.client import Surface
from afford.render.scene import Instance, Material

GLASS = ("glass", "bottle", "jar", "jug", "water")
"""kinds of objects that may be of glass"""
PHOTOGRAPHED, GLASSY, VARNISHED = 0.35, 0.4, 0.25
"""shares of materials with a photographed surface, of objects of glass where they may be, and of varnished materials"""
CLEAR = np.full((2, 2, 3), 245, np.uint8)


def natural(instances: Sequence[Instance], kinds: Mapping[int, str], photographs: Sequence[np.ndarray],
            rng: np.random.Generator) -> tuple[list[Instance], list[Surface]]:  # fmt: skip
    """Replace the materials of instances; all instances with the same image change alike.

    kinds: entity -> kind of object. photographs: surfaces (h, w, 3) uint8.
    """
    drawn: dict[tuple[int, int], tuple[np.ndarray, Surface]] = {}
    clear = {number: rng.random() < GLASSY for number, kind in sorted(kinds.items()) if kind in GLASS}
    shown, surfaces = [], []
    for one in instances:
        glass = clear.get(one.entity, False)
        key = id(one.material.image), one.entity if glass else -1
        if key not in drawn:
            drawn[key] = _glass(rng) if glass else _material(one.material, photographs, rng)
        image, surface = drawn[key]
        shown.append(replace(one, material=replace(one.material, image=image)))
        surfaces.append(surface)
    return shown, surfaces


def _glass(rng: np.random.Generator) -> tuple[np.ndarray, Surface]:
    return CLEAR, Surface(transmission=1.0, roughness=float(rng.choice([0.0, 0.0, 0.25])))


def _material(material: Material, photographs: Sequence[np.ndarray], rng: np.random.Generator) -> tuple[np.ndarray, Surface]:
    roughness = float(np.clip(material.roughness * np.exp(rng.normal(0, 0.4)), 0.04, 1.0))
    surface = Surface(0.0, float(rng.random() < VARNISHED), roughness, float(rng.uniform(0.2, 1.0)))
    if len(photographs) and not material.skin and rng.random() < PHOTOGRAPHED:
        photograph = photographs[int(rng.integers(len(photographs)))]
        side = int(min(*photograph.shape[:2], 512))
        top, left = (int(rng.integers(extent - side + 1)) for extent in photograph.shape[:2])
        return np.ascontiguousarray(photograph[top : top + side, left : left + side]), surface
    return material.image, surface
