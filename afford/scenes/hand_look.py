"""What a person's hands look like: skin tone, nails, creases, cloth, bare arm, glove, watch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.render.mesh import Mesh, smooth_normals
from afford.render.model import Material
from afford.render.solids import tube
from afford.scenes.hand_bones import LENGTHS, RADII, REST, WRIST
from afford.scenes.hand_shape import ARM_M, hand_shape

TONES = ((0.93, 0.72, 0.60), (0.88, 0.64, 0.50), (0.78, 0.54, 0.40), (0.60, 0.40, 0.28), (0.42, 0.27, 0.19))


@dataclass(frozen=True, eq=False)
class HandLook:
    """Looks shared by both hands of a person."""

    skin: Material
    cloth: Material
    cuff_m: float
    """Distance from the wrist back to the end of the sleeve; ARM_M for a bare arm."""

    def skin_mesh(self) -> Mesh:
        """Rest skin of the right hand, coloured."""
        shape = hand_shape()
        uv = np.stack([shape.vertices[:, 0] * 9, (shape.vertices[:, 1] + 0.8 * shape.vertices[:, 2]) * 9], -1)
        normals = smooth_normals(shape.vertices, shape.faces)
        return Mesh(shape.vertices, shape.faces, uv.astype(np.float32), normals, _skin_colour(normals))

    def sleeve_mesh(self) -> Mesh | None:
        """Rest sleeve of the right arm, or None when the arm is bare."""
        if self.cuff_m >= ARM_M:
            return None
        back = np.linspace(self.cuff_m, ARM_M + 0.02, 40)
        path = WRIST + np.c_[-back, np.zeros(40), np.zeros(40)]
        radius = np.interp(back, [0.0, 0.10, 0.22, 0.42], [0.036, 0.043, 0.052, 0.058])
        wrinkle = 1 + 0.03 * np.sin(back * 160) * np.exp(-(((back - self.cuff_m) / 0.12) ** 2))
        return tube(path, radius * wrinkle, 28, flat=0.85, repeat=(3.0, 6.0))


def person(rng: np.random.Generator) -> HandLook:
    """A person at random."""
    tone = np.array(TONES[rng.integers(len(TONES))]) * rng.uniform(0.95, 1.03)
    grain = rng.normal(0, 5, (128, 128, 1)) + 255 * tone
    cloth = rng.uniform(40, 200, 3) + rng.normal(0, 8, (128, 128, 1))
    skin = Material(np.clip(grain, 0, 255).astype(np.uint8), specular=0.035, roughness=0.5, skin=1.0)
    return HandLook(skin, Material(np.clip(cloth, 0, 255).astype(np.uint8), roughness=0.95, specular=0.01), rng.uniform(0.03, 0.07))


def _skin_colour(normals: np.ndarray) -> np.ndarray:
    """(v, 3) float32 vertex colour: reddish fingertips and joints, pale nails."""
    shape = hand_shape()
    colour = np.ones((len(normals), 3))
    for digit in range(5):
        for link in range(3):
            T = REST[2 + 3 * digit + link]
            near = np.exp(-((np.linalg.norm(shape.vertices - T[:3, 3], axis=1) / 0.011) ** 2))
            colour *= 1 - near[:, None] * [0.06, 0.16, 0.16]
        tip = T[:3, 3] + T[:3, 0] * LENGTHS[digit, 2]
        near = np.exp(-((np.linalg.norm(shape.vertices - tip, axis=1) / 0.011) ** 2))
        colour *= 1 - near[:, None] * [0.02, 0.16, 0.15]
        local = (shape.vertices - T[:3, 3]) @ T[:3, :3]
        nail = (shape.digit == digit) & (local[:, 2] < -0.45 * RADII[digit, 3]) & (local[:, 0] > 0.35 * LENGTHS[digit, 2])
        colour[nail & (np.abs(local[:, 1]) < 0.7 * RADII[digit, 3])] = [1.05, 0.93, 0.92]
    return colour.astype(np.float32)
