"""Walls of vessels: mass, centre of mass and inertia of a shell in place of a solid."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from schemas.grasp import GraspObject
from schemas.mesh import ObjectMesh


class Wall(NamedTuple):
    """Wall of an empty vessel."""

    thick_m: float
    density_kg_m3: float
    of: str
    """material, in words"""


STEEL, CERAMIC, GLASS, PLASTIC, CARD = 7800.0, 2300.0, 2500.0, 950.0, 700.0
WALLS = {
    "bottle": Wall(0.0010, PLASTIC, "plastic"), "bowl": Wall(0.0040, CERAMIC, "ceramic"), "box": Wall(0.0010, CARD, "cardboard"),
    "bucket": Wall(0.0020, PLASTIC, "plastic"), "can": Wall(0.0003, STEEL, "steel"), "carton": Wall(0.0008, CARD, "cardboard"),
    "cup": Wall(0.0030, GLASS, "glass"), "jar": Wall(0.0025, GLASS, "glass"), "jug": Wall(0.0015, PLASTIC, "plastic"),
    "kettle": Wall(0.0008, STEEL, "steel"), "mug": Wall(0.0035, CERAMIC, "ceramic"), "pan": Wall(0.0030, 2700.0, "aluminium"),
    "pitcher": Wall(0.0020, PLASTIC, "plastic"), "plate": Wall(0.0040, CERAMIC, "ceramic"), "pot": Wall(0.0010, STEEL, "steel"),
    "soap_dispenser": Wall(0.0015, PLASTIC, "plastic"), "spray_bottle": Wall(0.0012, PLASTIC, "plastic"),
    "teapot": Wall(0.0040, CERAMIC, "ceramic"), "wine_glass": Wall(0.0020, GLASS, "glass"),
}  # fmt: skip
"""category of the lexicon -> wall of it, empty"""


def with_wall(mesh: ObjectMesh, body: GraspObject, volume_m3: float, wall: Wall) -> GraspObject:
    """Give a body the mass of its walls.

    A mesh that has walls of its own, with less volume than its surface times the thickness, keeps its volume, and only the density
    changes. Any other mesh is taken for the outside, and becomes a shell of even thickness on its surface.
    """
    corner = mesh.vertices[mesh.faces].astype(np.float64)
    area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    shell = float(area.sum()) * wall.thick_m
    if volume_m3 <= shell:
        mass = volume_m3 * wall.density_kg_m3
        return replace(body, mass_kg=mass, inertia_kgm2=body.inertia_kgm2 * (mass / body.mass_kg))
    weight = np.repeat(area / area.sum() / 3, 3)
    spots = 0.5 * (corner + np.roll(corner, -1, axis=1)).reshape(-1, 3)
    com = weight @ spots
    arm = spots - com
    second = (arm * weight[:, None]).T @ arm
    mass = shell * wall.density_kg_m3
    return replace(body, mass_kg=mass, com_m=com, inertia_kgm2=mass * (np.trace(second) * np.eye(3) - second))
