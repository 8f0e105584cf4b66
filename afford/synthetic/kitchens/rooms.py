"""Rooms: worktop, wall, lighting, background objects and place mats. World frame: table top at z = 0, person at -y."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from afford.render import materials
from afford.render.mesh import translate
from afford.render.motion import axis_angle, pose
from afford.render.scene import BACKGROUND, Instance, Light, Material, linear
from afford.render.solids import box, patch
from afford.synthetic.assets import library
from afford.synthetic.kitchens.settle_env import rest_poses

TABLE = ((-0.95, 0.95), (-0.12, 0.82))
"""Extent of the worktop in x and y, metres."""
WALL_Y = 0.84


@dataclass(frozen=True, eq=False)
class Room:
    """Static part of a scene: instances and lighting."""

    instances: tuple[Instance, ...]
    light: Light


def build_room(setting: str, rng: np.random.Generator, clutter: int = 6) -> Room:
    """Build a random kitchen, workshop or desk with `clutter` objects at the back and others scattered beside them."""
    if setting not in SETTINGS:
        raise KeyError(f"unknown setting {setting!r}; choose one of {', '.join(sorted(SETTINGS))}")
    style = SETTINGS[setting]
    top = style.top(rng)
    shell = [*_table(rng, top), *_wall(rng, style.wall(rng)), *_mats(rng, style)]
    return Room((*shell, *_clutter(rng, style.standing, clutter), *_scatter(rng, style.lying)), _light(rng, _brightness(top)))


def build_empty(setting: str, rng: np.random.Generator) -> Room:
    """Build a room of the same kind without standing or scattered objects, but with mats."""
    style = SETTINGS[setting]
    top = style.top(rng)
    return Room((*_table(rng, top), *_wall(rng, style.wall(rng)), *_mats(rng, style)), _light(rng, _brightness(top)))


Maker = Callable[[np.random.Generator], Material]


@dataclass(frozen=True)
class Style:
    """Materials of a setting, and the kinds of objects that stand and lie in it."""

    top: Maker
    wall: Maker
    mats: tuple[Maker, ...]
    standing: tuple[str, ...]
    lying: tuple[str, ...]


def _kitchen_top(rng: np.random.Generator) -> Material:
    makers: tuple[Maker, ...] = (
        lambda r: materials.wood(r, None, 1024, int(r.integers(4, 8))),
        lambda r: materials.marble(r, 1024),
        lambda r: materials.granite(r, 1024),
        lambda r: materials.laminate(r, 1024),
    )
    return makers[rng.integers(4)](rng)


def _desk_wall(rng: np.random.Generator) -> Material:
    return materials.cloth(rng, 512) if rng.random() < 0.4 else materials.plastic(rng, (196, 194, 188), 256)


SETTINGS: dict[str, Style] = {
    "kitchen": Style(
        _kitchen_top,
        materials.tiles,
        (materials.cloth, materials.cloth, materials.paper, materials.ceramic),
        ("bottle", "can", "box", "jar", "carton", "bowl", "mug", "kettle", "plate", "can"),
        ("spoon", "knife", "spatula", "can"),
    ),
    "workshop": Style(
        lambda r: materials.wood(r, "pine" if r.random() < 0.5 else None, 1024, 5),
        lambda r: materials.wood(r, planks=6),
        (materials.cutting_mat, materials.paper, materials.leather),
        ("paint", "glue", "wood", "toolbox", "can", "drill", "paint"),
        ("wrench", "screwdriver", "hammer", "glue", "saw"),
    ),
    "desk": Style(
        lambda r: materials.wood(r, size=1024),
        _desk_wall,
        (materials.paper, materials.paper, materials.cutting_mat, materials.leather),
        ("book", "cup", "mug", "tape", "water", "box", "cup"),
        ("scissors", "phone", "tape", "stapler"),
    ),
}


def _table(rng: np.random.Generator, top: Material) -> list[Instance]:
    """Build the worktop with a front edge. The wood grain runs along x."""
    (x0, x1), (y0, y1) = TABLE
    per_m = 1.0 / 0.75
    slab = patch(
        np.array([x0, y0, 0.0]), np.array([x1 - x0, 0, 0]), np.array([0, y1 - y0, 0]), ((x1 - x0) * per_m, (y1 - y0) * per_m)
    )
    swapped = slab.uv[:, ::-1] + rng.random(2)
    slab = type(slab)(slab.vertices, slab.faces, swapped.astype(np.float32), slab.normals, slab.colour)
    front = patch(np.array([x0, y0, -0.04]), np.array([x1 - x0, 0, 0]), np.array([0, 0, 0.04]), (2.5, 0.06))
    floor = patch(np.array([-2.0, -1.2, -0.9]), np.array([4.0, 0, 0]), np.array([0, 2.4, 0]), (5, 3))
    return [
        Instance(slab, top, casts=False),
        Instance(front, top, casts=False),
        Instance(floor, materials.laminate(rng, 256), casts=False),
    ]


def _wall(rng: np.random.Generator, wall: Material) -> list[Instance]:
    """Build the back wall with a skirting ledge and a shelf."""
    back = patch(np.array([-2.0, WALL_Y, -0.1]), np.array([4.0, 0, 0]), np.array([0, 0, 1.6]), (8.0, 3.2))
    ledge = translate(box((4.0, 0.02, 0.06), 0.003, uv_per_m=2), 0, WALL_Y - 0.01, 0)
    shelf = translate(
        box((float(rng.uniform(0.6, 1.1)), 0.16, 0.022), 0.002, uv_per_m=2), float(rng.uniform(-0.5, 0.5)), WALL_Y - 0.08, 0.42
    )
    timber = materials.wood(rng)
    return [Instance(back, wall, casts=False), Instance(ledge, timber), Instance(shelf, timber)]


def _clutter(rng: np.random.Generator, kinds: tuple[str, ...], count: int) -> list[Instance]:
    """Place objects along the back and the sides, clear of the work area in the middle."""
    out: list[Instance] = []
    slots = rng.permutation(np.linspace(-0.62, 0.62, 9))[:count]
    for x in slots:
        model = library.build(kinds[rng.integers(len(kinds))], rng)
        T = _standing(x + rng.uniform(-0.02, 0.02), rng.uniform(0.60, 0.72), rng.uniform(-0.8, 0.8))
        out += model.instances(T, BACKGROUND)
    return out


def _mats(rng: np.random.Generator, style: Style) -> list[Instance]:
    """Place up to two thin objects flat on the sides of the worktop: a cloth, a sheet or a cutting mat."""
    out = []
    for k in range(int(rng.integers(0, 3))):
        wide, deep = rng.uniform(0.20, 0.36), rng.uniform(0.16, 0.28)
        sheet = translate(
            patch(np.array([-wide / 2, -deep / 2, 0.0]), np.array([wide, 0, 0]), np.array([0, deep, 0])),
            0,
            0,
            0.0007 + 0.0004 * k,
        )
        T = _standing(float(rng.choice([-1.0, 1.0])) * rng.uniform(0.38, 0.60), rng.uniform(0.15, 0.60), rng.uniform(-0.6, 0.6))
        out.append(Instance(sheet, style.mats[rng.integers(len(style.mats))](rng), T, casts=False))
    return out


def _scatter(rng: np.random.Generator, kinds: tuple[str, ...]) -> list[Instance]:
    """Drop a few small objects at one side of the worktop and keep their resting poses."""
    models = [library.build(kinds[rng.integers(len(kinds))], rng) for _ in range(3)]
    place = _standing(float(rng.choice([-1.0, 1.0])) * rng.uniform(0.48, 0.60), rng.uniform(0.30, 0.50), 0.0)
    poses = rest_poses([m.points for m in models], int(rng.integers(1 << 30)), spread_m=0.07)
    return [i for model, T in zip(models, poses, strict=True) for i in model.instances(place @ T, BACKGROUND)]


def _standing(x: float, y: float, yaw: float) -> np.ndarray:
    """Return the pose (4, 4) of an object on the table."""
    T = np.eye(4)
    T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T[:2, 3] = x, y
    return T


def _brightness(top: Material) -> float:
    """Return the mean linear luminance of the worktop, which fills most of the image."""
    return float(linear(top.image[::4, ::4]).mean())


def _light(rng: np.random.Generator, brightness: float) -> Light:
    """Sample indoor lighting: a warm or cool window or lamp from one side, and strong diffuse light.

    The camera exposure follows the brightness of the worktop.
    """
    side, warm = rng.choice([-1.0, 1.0]), rng.uniform(0.0, 1.0)
    key = np.array([1.0, 0.90 + 0.06 * (1 - warm), 0.78 + 0.22 * (1 - warm)]) * rng.uniform(0.60, 0.85)
    fill = np.array([0.90 + 0.08 * warm, 0.95, 1.0]) * rng.uniform(0.88, 1.0)
    sky = fill * rng.uniform(0.55, 0.65)
    direction = (side * rng.uniform(0.3, 0.7), rng.uniform(-0.1, 0.45), -0.8)
    return Light(
        direction,
        tuple(key),
        tuple(fill),
        tuple(sky),
        tuple(sky * [0.62, 0.5, 0.42]),
        softness=float(rng.uniform(0.16, 0.28)),
        exposure=float(np.clip(0.62 / (0.34 + brightness), 0.72, 1.25)),
    )


MAT_THICKNESS_M = 0.0012
MAT_CONTRAST = 0.95
"""Contrast of a mat's pattern relative to the original material."""
MaterialBuilder = Callable[[np.random.Generator], Material]
MAT_MATERIALS: dict[str, tuple[MaterialBuilder, ...]] = {
    "kitchen": (materials.ceramic, materials.ceramic, materials.carton),
    "workshop": (materials.paper, materials.carton),
    "desk": (materials.paper, materials.carton, materials.ceramic),
}


def place_mats(setting: str, rng: np.random.Generator, centre: np.ndarray) -> list[Instance]:
    """Place two flat patterned mats around `centre` (2,) on the table, metres."""
    return [_place_mat(rng, MAT_MATERIALS[setting], centre, level) for level in range(2)]


def _place_mat(rng: np.random.Generator, kinds: tuple[MaterialBuilder, ...], centre: np.ndarray, level: int) -> Instance:
    size = (float(rng.uniform(0.40, 0.60)), float(rng.uniform(0.30, 0.42)), MAT_THICKNESS_M * (1 + 0.6 * level))
    sheet = box(size, 0.0003, uv_per_m=float(rng.uniform(1.7, 2.8)))
    sheet = replace(sheet, uv=sheet.uv * np.array([1, -1], np.float32))
    x, y = centre + rng.uniform(-0.08, 0.08, 2) + (0.22 * level * rng.choice([-1, 1]), -0.04)
    lying = pose((x, y, 0.0), axis_angle((0, 0, 1), rng.uniform(-0.5, 0.5)))
    return Instance(sheet, _fade(kinds[rng.integers(len(kinds))](rng)), lying, casts=False)


def _fade(fresh: Material) -> Material:
    """Reduce the contrast of a material's pattern."""
    mean = fresh.image.mean(axis=(0, 1))
    return replace(fresh, image=(mean + MAT_CONTRAST * (fresh.image - mean)).astype(np.uint8))
