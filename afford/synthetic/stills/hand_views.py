"""Where lessons about hands are looked at from, and in which light: a head, something above the table, somebody across it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from afford.render.camera import intrinsics, look_at
from afford.render.motion import about
from afford.render.patterns import cloud, image, ramp
from afford.render.scene import Camera, Light

FIELD_OF_VIEW_DEG = (42.0, 96.0)


@dataclass(frozen=True)
class Stand:
    """Where a camera may stand, seen from what it looks at; azimuth 0 is the person's own side."""

    share: float
    azimuth_deg: tuple[float, float]
    elevation_deg: tuple[float, float]
    away_m: tuple[float, float]
    turned: bool
    """whether its pictures are turned by 180 degrees, which brings the person to the near side"""


STANDS = (Stand(0.62, (-28, 28), (25, 72), (0.24, 0.85), False), Stand(0.18, (-35, 35), (70, 87), (0.35, 1.0), False),
          Stand(0.20, (150, 210), (12, 75), (0.40, 1.0), True))  # fmt: skip
GAZE_SPREAD_M = np.array([0.13, 0.11, 0.05])
ROLL_RAD = 0.2
ROOM_M = ((-0.8, -0.26, 0.06), (0.8, 0.74, 1.2))
"""where a camera can be: before the wall, and not in the person"""
LAMP = (0.4, 1.15)
"""the lamps of a picture relative to those of its room, each colour for itself a little"""


def view(gaze: np.ndarray, size: tuple[int, int], rng: np.random.Generator) -> tuple[Camera, bool]:
    """A camera of `size` (width, height) that looks about at `gaze` (3,), and whether its picture is to be turned."""
    stand = STANDS[int(rng.choice(len(STANDS), p=[one.share for one in STANDS]))]
    side, up = (np.radians(rng.uniform(*span)) for span in (stand.azimuth_deg, stand.elevation_deg))
    target = gaze + rng.uniform(-1, 1, 3) * GAZE_SPREAD_M
    direction = np.array([np.sin(side) * np.cos(up), -np.cos(side) * np.cos(up), np.sin(up)])
    eye = target + rng.uniform(*stand.away_m) * direction
    eye = np.clip(eye, *ROOM_M)
    T = look_at(eye, target, float(rng.uniform(-ROLL_RAD, ROLL_RAD)))
    return Camera(intrinsics(*size, float(rng.uniform(*FIELD_OF_VIEW_DEG))), T, *size), stand.turned


def lit(light: Light, rng: np.random.Generator) -> Light:
    """The same room at another hour: lamps stronger or weaker, from elsewhere, of another colour."""
    x, y, z = light.direction
    turned = about((0, 0, 1), rng.uniform(-np.pi, np.pi)) @ np.array([x, y, z])
    key, fill = (rng.uniform(*LAMP) * rng.uniform(0.9, 1.1, 3) for _ in range(2))
    return replace(light, direction=_triple(turned), colour=_triple(np.multiply(light.colour, key)),
                   ceiling=_triple(np.multiply(light.ceiling, fill)), sky=_triple(np.multiply(light.sky, fill)),
                   exposure=light.exposure * float(rng.uniform(0.65, 1.15)))  # fmt: skip


def backdrop(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """(h, w, 3) uint8 of `size` (width, height): clouds of two colours, for where a room ends."""
    width, height = size
    side = 1 << int(np.ceil(np.log2(max(height, width))))
    colours = [tuple(rng.uniform(0, 255, 3)) for _ in range(2)]
    return image(ramp(cloud(rng, side, float(rng.uniform(0.8, 2.2)))[:height, :width], colours))


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    a, b, c = np.asarray(values, float).tolist()
    return a, b, c
