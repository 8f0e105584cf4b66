"""Where a clip happens: worktop, wall, light and things that only stand around. World: table top z = 0, person at -y."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from afford.render.mesh import moved
from afford.render.model import Instance, Light, Material
from afford.render.solids import box, patch
from afford.render.textures import linear
from afford.scenes import materials, objects

TABLE = ((-0.95, 0.95), (-0.12, 0.82))
"""Extent of the worktop in x and y, metres."""
WALL_Y = 0.84


@dataclass(frozen=True, eq=False)
class Room:
    """What does not move, and how it is lit."""

    instances: tuple[Instance, ...]
    light: Light


def build(setting: str, rng: np.random.Generator, clutter: int = 6) -> Room:
    """A kitchen, workshop or desk of its own; `clutter` things stand at the back and at the sides."""
    if setting not in SETTINGS:
        raise KeyError(f"unknown setting {setting!r}; choose one of {', '.join(sorted(SETTINGS))}")
    top, wall, kinds = SETTINGS[setting](rng)
    shell = [*_table(rng, top), *_wall(rng, wall)]
    return Room((*shell, *_clutter(rng, kinds, clutter)), _light(rng, _brightness(top)))


def _kitchen(rng: np.random.Generator) -> tuple[Material, Material, tuple[str, ...]]:
    tops = (lambda: materials.wood(rng, size=1024, planks=int(rng.integers(4, 8))), lambda: materials.marble(rng, 1024),
            lambda: materials.granite(rng, 1024), lambda: materials.laminate(rng, 1024))
    return tops[rng.integers(4)](), materials.tiles(rng), ("bottle", "can", "box", "jar", "carton", "bowl", "mug", "kettle", "plate", "can")


def _workshop(rng: np.random.Generator) -> tuple[Material, Material, tuple[str, ...]]:
    return materials.wood(rng, "pine", 1024, 5), materials.wood(rng, size=512, planks=6), ("paint", "glue", "wood", "toolbox", "can", "drill", "saw", "wrench")


def _desk(rng: np.random.Generator) -> tuple[Material, Material, tuple[str, ...]]:
    wall = materials.cloth(rng, 512) if rng.random() < 0.4 else materials.plastic(rng, (196, 194, 188), 256)
    return materials.wood(rng, size=1024, planks=1), wall, ("book", "cup", "mug", "tape", "water", "box", "phone", "scissors")


SETTINGS: dict[str, Callable[[np.random.Generator], tuple[Material, Material, tuple[str, ...]]]] = {
    "kitchen": _kitchen, "workshop": _workshop, "desk": _desk}


def _table(rng: np.random.Generator, top: Material) -> list[Instance]:
    """Worktop with a front edge; the grain runs along x."""
    (x0, x1), (y0, y1) = TABLE
    per_m = 1.0 / 0.75
    slab = patch(np.array([x0, y0, 0.0]), np.array([x1 - x0, 0, 0]), np.array([0, y1 - y0, 0]), ((x1 - x0) * per_m, (y1 - y0) * per_m))
    swapped = slab.uv[:, ::-1] + rng.random(2)
    slab = type(slab)(slab.vertices, slab.faces, swapped.astype(np.float32), slab.normals, slab.colour)
    front = patch(np.array([x0, y0, -0.04]), np.array([x1 - x0, 0, 0]), np.array([0, 0, 0.04]), (2.5, 0.06))
    floor = patch(np.array([-2.0, -1.2, -0.9]), np.array([4.0, 0, 0]), np.array([0, 2.4, 0]), (5, 3))
    return [Instance(slab, top, casts=False), Instance(front, top, casts=False), Instance(floor, materials.laminate(rng, 256), casts=False)]


def _wall(rng: np.random.Generator, wall: Material) -> list[Instance]:
    """Back wall, a skirting ledge and a shelf."""
    back = patch(np.array([-2.0, WALL_Y, -0.1]), np.array([4.0, 0, 0]), np.array([0, 0, 1.6]), (8.0, 3.2))
    ledge = moved(box((4.0, 0.02, 0.06), 0.003, uv_per_m=2), 0, WALL_Y - 0.01, 0)
    shelf = moved(box((float(rng.uniform(0.6, 1.1)), 0.16, 0.022), 0.002, uv_per_m=2), float(rng.uniform(-0.5, 0.5)), WALL_Y - 0.08, 0.42)
    timber = materials.wood(rng)
    return [Instance(back, wall, casts=False), Instance(ledge, timber), Instance(shelf, timber)]


def _clutter(rng: np.random.Generator, kinds: tuple[str, ...], count: int) -> list[Instance]:
    """Things along the back and the sides, clear of the middle where hands work."""
    out: list[Instance] = []
    slots = rng.permutation(np.linspace(-0.62, 0.62, 9))[:count]
    for x in slots:
        kind = kinds[rng.integers(len(kinds))]
        model = objects.build(kind, rng)
        T = np.eye(4)
        yaw = rng.uniform(-0.8, 0.8)
        T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
        T[:3, 3] = (x + rng.uniform(-0.02, 0.02), rng.uniform(0.60, 0.72), 0.0)
        out += model.instances(T, -1)
    return out


def _brightness(top: Material) -> float:
    """Mean linear luminance of the worktop, which fills most of the image."""
    return float(linear(top.image[::4, ::4]).mean())


def _light(rng: np.random.Generator, brightness: float) -> Light:
    """A window or a lamp, warm or cool, from the left or right; the camera exposes for the worktop."""
    side, warm = rng.choice([-1.0, 1.0]), rng.uniform(0.0, 1.0)
    key = np.array([1.0, 0.90 + 0.06 * (1 - warm), 0.78 + 0.22 * (1 - warm)]) * rng.uniform(1.5, 1.9)
    fill = np.array([0.90 + 0.08 * warm, 0.95, 1.0]) * rng.uniform(0.50, 0.65)
    sky = fill * rng.uniform(0.50, 0.62)
    direction = (side * rng.uniform(0.3, 0.7), rng.uniform(-0.1, 0.45), -0.8)
    return Light(direction, tuple(key), tuple(fill), tuple(sky), tuple(sky * [0.62, 0.5, 0.42]), softness=float(rng.uniform(0.07, 0.16)),
                 exposure=float(np.clip(0.62 / (0.34 + brightness), 0.72, 1.25)))
