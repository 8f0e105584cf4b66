"""Static part of an interaction: a person at a table, other objects, lighting, and a fixed camera across the table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from afford.render import materials
from afford.render.camera import look_at
from afford.render.motion import axis_angle, pose
from afford.render.scene import BACKGROUND, Camera, Instance, Light, Material, linear
from afford.render.solids import patch, tube
from afford.synthetic.assets import library
from afford.synthetic.human_hand.appearance import HandAppearance, random_person
from afford.synthetic.human_hand.hand_model import HandModel
from afford.synthetic.kitchens.scene_builder import CENTRE
from afford.synthetic.tabletop.hand_placement import table_axes
from afford.synthetic.tabletop.manipulations import Manipulation
from afford.synthetic.tabletop.tabletop_objects import COMPANION_OFFSET_M, COMPANIONS

KINECT_FOCAL_PX, KINECT_CROP_PX = 365.0, 300
"""Nominal focal length of the depth camera of a Kinect 2 on its grid, and the size of the paper's crop, px."""
VIEWS_DEG = {1: 0.0, 2: 38.0, 3: -38.0}
"""Azimuth of the three cameras, degrees: across the table from the person, and from both sides."""
CLUTTER = ("box", "jar", "carton", "bowl", "tape", "glue", "mug", "can", "plate", "stapler", "paint")
TABLE_M = ((-0.75, 0.75), (-0.16, 0.95))


@dataclass(frozen=True, eq=False)
class TabletopScene:
    """Static instances, lighting and camera."""

    still: tuple[Instance, ...]
    light: Light
    camera: Camera


def camera_view(subject: int) -> int:
    """Return the camera, 1 to 3, that views a subject."""
    return 1 + (subject - 1) % 3


@lru_cache(maxsize=4)
def look_of(subject: int) -> HandAppearance:
    """Return the appearance of a subject: skin, sleeve and watch."""
    return random_person(np.random.default_rng([subject, 40]))


@lru_cache(maxsize=8)
def hand_of(subject: int, side: str) -> HandModel:
    """Return the hand model of a subject."""
    return HandModel.build(side, look_of(subject))


def build_scene(
    manipulation: Manipulation, object_type: str, subject: int, clutter: int, size_px: int, rng: np.random.Generator
) -> TabletopScene:
    """Build the table with objects beside the manipulated one, and a camera on the middle of the manipulation."""
    top = _top(rng)
    beside = COMPANION_OFFSET_M.get(object_type, (0.0, 0.0))
    shift = table_axes(manipulation.hold) @ np.array(beside)
    middle = 0.5 * (manipulation.object_track.at(0)[:3, 3] + manipulation.object_track.end()[:3, 3] + 0.8 * shift)
    still = [
        *_table(rng, top),
        *_torso(subject),
        *_companion(manipulation, object_type, rng),
        *_clutter(manipulation, middle, clutter, rng),
    ]
    light = _light(rng, float(linear(top.image[::4, ::4]).mean()))
    return TabletopScene(
        tuple(still), light, _camera(middle, float(manipulation.hold.model.points[:, 2].max()), subject, size_px, rng)
    )


def _camera(middle: np.ndarray, tall_m: float, subject: int, size_px: int, rng: np.random.Generator) -> Camera:
    """Sample a camera on the middle of the manipulation, farther away for tall objects."""
    azimuth = np.radians(VIEWS_DEG[camera_view(subject)]) + rng.uniform(-0.1, 0.1)
    height, far = rng.uniform(0.88, 1.05), rng.uniform(0.51, 0.58) + 0.8 * max(0.0, tall_m - 0.12)
    out = np.array([np.sin(azimuth) * np.cos(height), np.cos(azimuth) * np.cos(height), np.sin(height)])
    target = middle + (*rng.uniform(-0.02, 0.02, 2), 0.03 + 0.2 * tall_m)
    focal = KINECT_FOCAL_PX * size_px / KINECT_CROP_PX
    K = np.array([[focal, 0, (size_px - 1) / 2], [0, focal, (size_px - 1) / 2], [0, 0, 1.0]])
    return Camera(K, look_at(target + far * out, target, rng.uniform(-0.03, 0.03)), size_px, size_px)


def _top(rng: np.random.Generator) -> Material:
    kind = int(rng.integers(5))
    if kind == 4:
        return materials.plastic(rng, tuple(rng.uniform(70, 225) * np.array([1, 1, 1]) + rng.uniform(-18, 18, 3)), 256)
    if kind == 0:
        return materials.wood(rng, None, 256, int(rng.integers(1, 5)))
    return (materials.marble, materials.granite, materials.laminate)[kind - 1](rng, 256)


def _table(rng: np.random.Generator, top: Material) -> list[Instance]:
    (x0, x1), (y0, y1) = TABLE_M
    repeat = (x1 - x0) * rng.uniform(1.3, 2.2), (y1 - y0) * rng.uniform(1.3, 2.2)
    slab = patch(np.array([x0, y0, 0.0]), np.array([x1 - x0, 0, 0]), np.array([0, y1 - y0, 0]), repeat)
    edge = patch(np.array([x0, y0, -0.04]), np.array([x1 - x0, 0, 0]), np.array([0, 0, 0.04]), (2.5, 0.06))
    floor = patch(np.array([-2.0, -2.0, -0.74]), np.array([4.0, 0, 0]), np.array([0, 4.0, 0]), (6, 6))
    return [Instance(slab, top, casts=False), Instance(edge, top, casts=False),
            Instance(floor, materials.laminate(rng, 128), casts=False)]  # fmt: skip


def _torso(subject: int) -> list[Instance]:
    """Build a person's chest in the cloth of the sleeves, behind the edge of the table."""
    look = look_of(subject)
    z = np.linspace(-0.45, 0.55, 9)
    chest = tube(np.stack([0 * z, 0 * z - 0.40, z], -1), np.full(9, 0.17), 24, flat=0.62, up=(0, 1, 0), repeat=(4, 4))
    return [Instance(chest, look.cloth)]


def _companion(manipulation: Manipulation, object_type: str, rng: np.random.Generator) -> list[Instance]:
    """Place the object that a tool is used on within reach of the tool, for every affordance."""
    if object_type not in COMPANIONS:
        return []
    stand, tip = manipulation.hold.T_world_obj, np.asarray(manipulation.hold.model.tip)
    place = (stand @ np.append(tip, 1.0))[:3] + table_axes(manipulation.hold) @ np.array(COMPANION_OFFSET_M[object_type])
    turned = stand[:3, :3] @ axis_angle((0, 0, 1), rng.uniform(-0.12, 0.12))
    at = pose((place[0], place[1], 0.0), turned)
    return [Instance(part.mesh, part.material, at) for part in COMPANIONS[object_type](rng)]


def _clutter(manipulation: Manipulation, middle: np.ndarray, most: int, rng: np.random.Generator) -> list[Instance]:
    """Place up to `most` other objects clear of hand and object: at the other side, or nearer to the camera."""
    out: list[Instance] = []
    flip = 1.0 if manipulation.hold.side == "right" else -1.0
    for k in range(int(rng.integers(0, most + 1))):
        angle = np.radians((rng.uniform(115, 165), rng.uniform(35, 80), rng.uniform(185, 205))[k % 3])
        reach = rng.uniform(0.21, 0.27)
        x, y = middle[0] + flip * reach * np.cos(angle), middle[1] + reach * np.sin(angle)
        model = library.build(CLUTTER[int(rng.integers(len(CLUTTER)))], rng)
        out += model.instances(pose((x, y, 0.0), axis_angle((0, 0, 1), rng.uniform(-3, 3))), BACKGROUND)
    return out


def _light(rng: np.random.Generator, brightness: float) -> Light:
    """Sample a lamp or window from one side and strong ceiling light; the camera exposes for the table."""
    warm = rng.uniform(0, 1)
    key = np.array([1.0, 0.90 + 0.06 * (1 - warm), 0.78 + 0.22 * (1 - warm)]) * rng.uniform(0.55, 0.85)
    fill = np.array([0.90 + 0.08 * warm, 0.95, 1.0]) * rng.uniform(0.85, 1.0)
    sky = fill * rng.uniform(0.5, 0.65)
    direction = (float(rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 0.7)), float(rng.uniform(-0.5, 0.3)), -0.8)
    exposure = float(np.clip(0.62 / (0.34 + brightness), 0.72, 1.25) * rng.uniform(0.85, 1.1))
    return Light(direction, tuple(key), tuple(fill), tuple(sky), tuple(0.55 * sky), softness=float(rng.uniform(0.12, 0.28)),
                 centre=(float(CENTRE[0]), float(CENTRE[1]), 0.05), radius_m=0.6, exposure=exposure, vignette=0.05)  # fmt: skip
