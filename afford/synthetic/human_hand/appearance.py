"""Appearance of a person's hands: skin, nails, creases, and sleeve, rolled-up cuff, glove, watch or bracelet."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from afford.common.palette import TONES
from afford.render import materials
from afford.render.mesh import Mesh, merge, smooth_normals, transform, translate
from afford.render.patterns import cloud
from afford.render.scene import Material
from afford.render.solids import lathe, tube
from afford.synthetic.human_hand.skeleton import LENGTHS, RADII, REST, WRIST
from afford.synthetic.human_hand.skin import ARM_M, HandShape, hand_shape

GLOVES = ((206, 214, 224), (84, 140, 190), (222, 186, 60), (52, 54, 58))


@dataclass(frozen=True, eq=False)
class HandAppearance:
    """Appearance shared by both hands of a person."""

    skin: Material
    cloth: Material
    cuff_m: float
    """Distance from the wrist back to the end of the sleeve, metres; ARM_M for a bare arm."""
    folds: np.ndarray
    """(3,) phases of the sleeve's folds."""
    gloved: bool = False
    worn: Mesh | None = None
    """Watch or bracelet on the forearm, in the palm frame at rest."""
    worn_look: Material | None = None

    def skin_mesh(self) -> Mesh:
        """Return the skin mesh of the right hand at rest, with vertex colours."""
        shape = hand_shape()
        uv = np.stack([shape.vertices[:, 0] * 8, (shape.vertices[:, 1] + 0.8 * shape.vertices[:, 2]) * 8], -1)
        normals = smooth_normals(shape.vertices, shape.faces)
        colour = np.ones(normals.shape, np.float32) if self.gloved else _skin_colour(shape, normals)
        return Mesh(shape.vertices, shape.faces, uv.astype(np.float32), normals, colour)

    def sleeve_mesh(self) -> Mesh | None:
        """Return the sleeve mesh of the right arm at rest, with a turned-up cuff, or None for a bare arm."""
        if self.cuff_m >= ARM_M:
            return None
        back = np.linspace(self.cuff_m, ARM_M + 0.02, 56)
        radius = np.interp(back, [0.0, 0.10, 0.22, 0.42], [0.034, 0.042, 0.052, 0.060])
        cuff = back < self.cuff_m + 0.035
        outer = self._shell(back, radius + np.where(cuff, 0.0022, 0.0), back - self.cuff_m)
        lining = self._shell(back[:8][::-1], radius[:8][::-1] - 0.003, (back - self.cuff_m)[:8][::-1])
        return merge(outer, lining)

    def _shell(self, back: np.ndarray, radius: np.ndarray, along: np.ndarray) -> Mesh:
        """Build a sleeve of a given radius, with folds that get deeper away from the cuff."""
        tube_ = tube(WRIST + np.c_[-back, np.zeros((len(back), 2))], radius, 36, flat=0.86, repeat=(2.0, 10.0 * np.ptp(back)))
        offset = tube_.vertices - WRIST * [0, 1, 1]
        angle, depth = (
            np.arctan2(offset[:, 2], offset[:, 1]),
            np.clip(-offset[:, 0] + WRIST[0] - self.cuff_m - 0.035, 0, 0.05) / 0.05,
        )
        turn, twist, drape = self.folds
        wave = np.sin(offset[:, 0] * 95 + 2 * angle + 2.5 * np.sin(angle + turn + offset[:, 0] * 23))
        wave = wave + 0.8 * np.sin(offset[:, 0] * 57 - 3 * angle + twist) + 0.7 * np.sin(3 * angle + drape)
        swell = 1 + (0.030 * depth * wave)[:, None] * [0, 1, 1]
        points = (WRIST * [0, 1, 1] + offset * swell).astype(np.float32)
        return replace(tube_, vertices=points, normals=_seamless(points, tube_))


def _seamless(points: np.ndarray, shape: Mesh) -> np.ndarray:
    """Return vertex normals that agree along the seam of a tube."""
    _, place = np.unique(np.round(points * 1e5).astype(np.int64), axis=0, return_inverse=True)
    place = place.reshape(-1)
    welded = np.zeros((place.max() + 1, 3), np.float32)
    welded[place] = points
    return smooth_normals(welded, place[shape.faces])[place]


def random_person(rng: np.random.Generator) -> HandAppearance:
    """Sample a person: mostly long sleeves, sometimes rolled-up or no sleeves, and occasionally gloves or a watch."""
    gloved = bool(rng.random() < 0.12)
    tone = np.array(TONES[rng.integers(len(TONES))]) * rng.uniform(0.95, 1.04)
    skin = materials.plastic(rng, GLOVES[rng.integers(len(GLOVES))], 256) if gloved else materials.skin(rng, tuple(tone))
    style = rng.random()
    cuff = float(rng.uniform(0.015, 0.05) if style < 0.6 or gloved else rng.uniform(0.09, 0.16) if style < 0.8 else ARM_M)
    watch, strap = (_watch(rng), materials.leather(rng)) if cuff > 0.06 and rng.random() < 0.5 else (None, None)
    return HandAppearance(skin, materials.cloth(rng), cuff, rng.uniform(0, 2 * np.pi, 3), gloved, watch, strap)


def _watch(rng: np.random.Generator) -> Mesh:
    """Build a strap round the wrist, with a case on the back of the hand."""
    turn = np.linspace(0, 2 * np.pi, 33)
    at = WRIST[0] - 0.030
    ring = np.stack([0 * turn + at, 0.0272 * np.cos(turn), WRIST[2] + 0.0196 * np.sin(turn)], -1)
    strap = tube(ring, 0.0085, 12, flat=0.22, up=(1.0, 0.0, 0.0))
    wide = float(rng.uniform(0.014, 0.018))
    case = lathe(np.array([(0, 0), (wide, 0), (wide, 0.007), (wide - 0.002, 0.009), (0, 0.009)]), 28)
    down = np.diag([1.0, -1.0, -1.0, 1.0])
    return merge(strap, translate(transform(case, down), at, 0.0, WRIST[2] - 0.0190))


def _skin_colour(shape: HandShape, normals: np.ndarray) -> np.ndarray:
    """Return vertex colours (v, 3) float32: reddish palm, fingertips and joints, dark creases, pale nails."""
    blotch = np.random.default_rng(11)
    colour = np.ones((len(normals), 3))
    palmar = np.clip(normals[:, 2], 0, 1) * (shape.vertices[:, 0] > WRIST[0] - 0.02)
    colour *= 1 - palmar[:, None] * [-0.05, 0.03, 0.05]
    field = cloud(blotch, 64, 1.2)
    cell = (np.abs(shape.vertices[:, :2]) * 900).astype(int) % 64
    colour *= 1 + (field[cell[:, 0], cell[:, 1]] - 0.5)[:, None] * [0.05, 0.12, 0.12]
    for digit in range(5):
        for link in range(3):
            colour *= _joint(shape, normals, digit, link)
        T = REST[4 + 3 * digit]
        tip = T[:3, 3] + T[:3, 0] * LENGTHS[digit, 2]
        colour *= 1 - _gaussian_near(shape.vertices, tip, 0.012)[:, None] * [0.01, 0.15, 0.13]
        colour = np.where(_nail(shape, normals, digit)[:, None], [1.16, 1.02, 1.0], colour)
    return colour.astype(np.float32)


def _gaussian_near(points: np.ndarray, centre: np.ndarray, width: float) -> np.ndarray:
    return np.exp(-((np.linalg.norm(points - centre, axis=1) / width) ** 2))


def _joint(shape: HandShape, normals: np.ndarray, digit: int, link: int) -> np.ndarray:
    """Return a colour factor (v, 3): redder knuckles on the back, and a crease on the palm side."""
    T = REST[2 + 3 * digit + link]
    local = (shape.vertices - T[:3, 3]) @ T[:3, :3]
    mine = shape.digit == digit if link else np.abs(local[:, 1]) < RADII[digit, 0]
    near = _gaussian_near(shape.vertices, T[:3, 3], 0.012) * (0.4 + 0.6 * ((normals @ T[:3, 2]) < 0))
    crease = np.exp(-((local[:, 0] / 0.0016) ** 2)) * mine * (np.linalg.norm(local, axis=1) < 0.016) * (1.0 if link else 0.5)
    return (1 - near[:, None] * [0.08, 0.20, 0.18]) * (1 - crease[:, None] * [0.25, 0.36, 0.36])


def _nail(shape: HandShape, normals: np.ndarray, digit: int) -> np.ndarray:
    """Mark the vertices (v,) of a nail: an oval on the back of the last bone."""
    T = REST[4 + 3 * digit]
    local = (shape.vertices - T[:3, 3]) @ T[:3, :3]
    long, wide = LENGTHS[digit, 2], RADII[digit, 3]
    oval = ((local[:, 0] - 0.85 * long) / (0.62 * long)) ** 2 + (local[:, 1] / (0.80 * wide)) ** 2 < 1
    return (shape.digit == digit) & oval & (normals @ T[:3, 2] < -0.25)
