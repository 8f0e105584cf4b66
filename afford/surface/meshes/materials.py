"""Materials that fill space, so that they go on across the seams of a texture: colour is a function of the place alone.

Points are (n, 3) in metres; the first axis is the long one of the object, along which wood grows and metal is brushed.
"""

from __future__ import annotations

import numpy as np

WAVES = 7
METAL, WOOD, RUBBER, PLASTIC, CERAMIC = range(5)


def material_colours(kind: int, points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n, 3) uint8 sRGB of a material at places."""
    rgb = (_metal, _wood, _rubber, _plastic, _ceramic)[kind](points, rng)
    return np.clip(rgb + rng.normal(0, 1.5, (len(points), 1)), 0, 255).astype(np.uint8)


def wave_noise(points: np.ndarray, rng: np.random.Generator, scale_m: float) -> np.ndarray:
    """(n,) smooth noise, mean 0, about -1..1, with features of `scale_m` and finer: waves of random directions."""
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
