"""Random light of rooms for Cycles: a map of the surroundings with windows and lamps, and lamps near the table.

World axes: z up, table in front of a wall at +y, person at -y.
"""

from __future__ import annotations

import cv2
import numpy as np

from afford.render.cycles.client import Lit

ROWS, COLUMNS = 64, 128
WARM, DAY = np.array([1.0, 0.72, 0.45]), np.array([0.85, 0.95, 1.1])
"""colours of lamps and of daylight, linear RGB"""
PATCHES = 14
"""dull rectangles of furniture in the surroundings"""


def indoor_light(rng: np.random.Generator, eye: np.ndarray, target: np.ndarray) -> Lit:
    """Draw the light of a picture taken from `eye` (3,) of a scene around `target` (3,), world metres."""
    focus = float(np.linalg.norm(target - eye))
    f_number = float(rng.uniform(1.4, 5.6)) if rng.random() < 0.5 else 0.0
    return Lit(surroundings(rng), lamps(rng, target), focus * float(rng.uniform(0.9, 1.1)), f_number)


def surroundings(rng: np.random.Generator) -> np.ndarray:
    """Draw radiance (64, 128, 3) float32: walls, floor, ceiling, furniture, up to three windows, up to three lamps."""
    wall = rng.uniform(0.15, 0.6) * rng.uniform(0.8, 1.15, 3)
    sky = np.broadcast_to(wall, (ROWS, COLUMNS, 3)).copy()
    sky[: int(rng.integers(8, 20))] = rng.uniform(0.35, 0.9) * rng.uniform(0.92, 1.05, 3)
    sky[int(rng.integers(36, 44)) :] = rng.uniform(0.05, 0.3) * rng.uniform(0.75, 1.1, 3)
    for _ in range(PATCHES):
        _rectangle(sky, rng, (20, 56), rng.uniform(0.03, 0.8) * rng.uniform(0.6, 1.2, 3), (2, 16))
    for _ in range(int(rng.integers(0, 4))):
        _rectangle(sky, rng, (10, 32), rng.uniform(3, 18) * DAY * rng.uniform(0.9, 1.1, 3), (5, 16))
    for _ in range(int(rng.integers(0, 4))):
        _rectangle(sky, rng, (1, 14), rng.uniform(8, 40) * (WARM + rng.random() * (DAY - WARM)), (2, 5))
    return cv2.GaussianBlur(sky.astype(np.float32), (0, 0), 0.7)


def _rectangle(sky: np.ndarray, rng: np.random.Generator, rows: tuple[int, int], radiance: np.ndarray,
               size: tuple[int, int]) -> None:  # fmt: skip
    top, left = int(rng.integers(*rows)), int(rng.integers(COLUMNS))
    tall, wide = rng.integers(*size, 2)
    columns = np.arange(left, left + wide) % COLUMNS
    sky[top : top + tall, columns] = radiance


def lamps(rng: np.random.Generator, target: np.ndarray) -> np.ndarray:
    """Draw up to two square lamps above the table (n, 10), as in `Lit.lamps`; small ones give hard shadows."""
    rows = []
    for _ in range(int(rng.integers(0, 3))):
        angle, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.9, 2.2)
        place = target + (rng.uniform(0.2, 1.4) * np.cos(angle), rng.uniform(0.2, 1.0) * np.sin(angle), height)
        colour = WARM + rng.random() * (DAY - WARM)
        rows.append((*place, *target, float(np.exp(rng.uniform(np.log(0.04), np.log(0.8)))), *(colour * rng.uniform(4, 30))))
    return np.array(rows, np.float64).reshape(-1, 10)
