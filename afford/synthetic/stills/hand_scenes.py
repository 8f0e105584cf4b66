"""People, free hand poses, cameras and lighting for images of hands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from afford.render.camera import intrinsics, look_at
from afford.render.mesh import translate
from afford.render.motion import Pose, axis_angle, pose
from afford.render.patterns import cloud, image, ramp
from afford.render.scene import BACKGROUND, Camera, Instance, Light
from afford.render.solids import lathe
from afford.synthetic.assets.object_model import palm_frame
from afford.synthetic.human_hand.appearance import HandAppearance, random_person
from afford.synthetic.human_hand.hand_model import HandModel
from afford.synthetic.human_hand.skeleton import CLOSED, HIGH, LOW, OPENING, POSTURES
from afford.synthetic.human_hand.skin import ARM_M
from afford.synthetic.kitchens.world import elbow
from schemas.video import SIDES

CUFF_M = (0.0, 0.35)
"""range of the distance from the wrist back to the end of a sleeve, metres"""
BARE, BARE_GLOVES = 0.3, 0.25
"""share of people without sleeves; share of gloved people who keep their gloves"""
REACH_M = ((-0.14, 0.32), (0.0, 0.52), (0.015, 0.26))
"""range of a free palm's position: to its own side, away from the person, above the table"""
TURN_RAD, PITCH = 0.7, 0.45
"""largest angle between fingers and forearm, and largest slope of the fingers"""
PALM_RAD = (-0.5, 2.0)
"""range of the palm's rotation: 0 faces down, pi / 2 faces the other hand"""
NEAREST_M = 0.09
"""minimum distance between the palms of two hands, metres"""


@dataclass(frozen=True, eq=False)
class PersonModel:
    """Two hands, with head and trunk for cameras across the table."""

    hands: dict[str, HandModel]
    body: tuple[Instance, ...]

    @staticmethod
    def sample(rng: np.random.Generator) -> PersonModel:
        """Sample a person."""
        look = random_sleeves(rng)
        return PersonModel({side: HandModel.build(side, look) for side in SIDES}, _body(look, rng))


def random_sleeves(rng: np.random.Generator) -> HandAppearance:
    """Sample the appearance of hands with sleeves of any length or none, and occasionally gloves."""
    look = random_person(rng)
    while look.gloved and rng.random() > BARE_GLOVES:
        look = random_person(rng)
    return replace(look, cuff_m=ARM_M if rng.random() < BARE else float(rng.uniform(*CUFF_M)))


def free_hand_pose(side: str, rng: np.random.Generator) -> tuple[Pose, np.ndarray]:
    """Sample a palm pose above the table and joint angles (20,), as in reaching, showing or resting."""
    sign = 1.0 if side == "right" else -1.0
    at = np.array([rng.uniform(*span) for span in REACH_M]) * (sign, 1, 1)
    ahead = at - elbow(side, pose(at))
    ahead = axis_angle((0, 0, 1), rng.uniform(-TURN_RAD, TURN_RAD)) @ (ahead * (1, 1, 0.4))
    ahead = ahead / np.linalg.norm(ahead) + (0, 0, rng.uniform(-PITCH, PITCH))
    turn = rng.uniform(*PALM_RAD)
    palm = palm_frame(at, (-sign * np.sin(turn), 0.15, -np.cos(turn)), ahead)
    kinds = [*POSTURES.values(), *OPENING.values(), *CLOSED.values()]
    first, second = (np.array(kinds[int(rng.integers(len(kinds)))]) for _ in range(2))
    angles = first + (second - first) * rng.random() + rng.normal(0, 0.08, 20)
    return palm, np.clip(angles, LOW, HIGH)


def hands_apart(palms: Sequence[Pose]) -> bool:
    """Return True when hands at these palm poses do not collide."""
    return len(palms) < 2 or float(np.linalg.norm(palms[0][:3, 3] - palms[1][:3, 3])) >= NEAREST_M


def _body(look: HandAppearance, rng: np.random.Generator) -> tuple[Instance, ...]:
    """Build trunk and head at the edge of the table. Their skin is not labelled as a hand."""
    place = pose((float(rng.uniform(-0.05, 0.05)), -0.50, -0.45))
    trunk = lathe(np.array([(0.0, 0.0), (0.17, 0.0), (0.19, 0.45), (0.21, 0.80), (0.08, 0.92), (0.0, 0.93)]), 24, repeat_u=4.0)
    turn = np.linspace(-np.pi / 2, np.pi / 2, 12)
    head = translate(lathe(np.stack([0.085 * np.cos(turn), 0.12 * np.sin(turn)], 1), 20), 0.0, 0.04, 1.06)
    return Instance(trunk, look.cloth, place, BACKGROUND), Instance(head, look.skin, place, BACKGROUND)


FIELD_OF_VIEW_DEG = (42.0, 96.0)


@dataclass(frozen=True)
class ViewRange:
    """Range of camera positions relative to the viewed point; azimuth 0 is the person's own side."""

    share: float
    azimuth_deg: tuple[float, float]
    elevation_deg: tuple[float, float]
    away_m: tuple[float, float]
    turned: bool
    """True when images are rotated by 180 degrees, so that the person is on the near side"""


VIEW_RANGES = (ViewRange(0.62, (-28, 28), (25, 72), (0.24, 0.85), False), ViewRange(0.18, (-35, 35), (70, 87), (0.35, 1.0), False),
          ViewRange(0.20, (150, 210), (12, 75), (0.40, 1.0), True))  # fmt: skip
GAZE_SPREAD_M = np.array([0.13, 0.11, 0.05])
ROLL_RAD = 0.2
ROOM_M = ((-0.8, -0.26, 0.06), (0.8, 0.74, 1.2))
"""bounds of the camera position: in front of the wall and outside the person"""
LAMP = (0.4, 1.15)
"""range of a lamp's brightness relative to that of the room"""


def sample_camera(gaze: np.ndarray, size: tuple[int, int], rng: np.random.Generator) -> tuple[Camera, bool]:
    """Sample a camera of `size` (width, height) that looks near `gaze` (3,), and whether its image is rotated by 180 degrees."""
    stand = VIEW_RANGES[int(rng.choice(len(VIEW_RANGES), p=[one.share for one in VIEW_RANGES]))]
    side, up = (np.radians(rng.uniform(*span)) for span in (stand.azimuth_deg, stand.elevation_deg))
    target = gaze + rng.uniform(-1, 1, 3) * GAZE_SPREAD_M
    direction = np.array([np.sin(side) * np.cos(up), -np.cos(side) * np.cos(up), np.sin(up)])
    eye = target + rng.uniform(*stand.away_m) * direction
    eye = np.clip(eye, *ROOM_M)
    T = look_at(eye, target, float(rng.uniform(-ROLL_RAD, ROLL_RAD)))
    return Camera(intrinsics(*size, float(rng.uniform(*FIELD_OF_VIEW_DEG))), T, *size), stand.turned


def relight(light: Light, rng: np.random.Generator) -> Light:
    """Sample other lighting of a room: brightness, direction and colour of the lamps."""
    x, y, z = light.direction
    turned = axis_angle((0, 0, 1), rng.uniform(-np.pi, np.pi)) @ np.array([x, y, z])
    key, fill = (rng.uniform(*LAMP) * rng.uniform(0.9, 1.1, 3) for _ in range(2))
    return replace(light, direction=_triple(turned), colour=_triple(np.multiply(light.colour, key)),
                   ceiling=_triple(np.multiply(light.ceiling, fill)), sky=_triple(np.multiply(light.sky, fill)),
                   exposure=light.exposure * float(rng.uniform(0.65, 1.15)))  # fmt: skip


def backdrop(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Return a background image (h, w, 3) uint8 of two-coloured noise, of `size` (width, height)."""
    width, height = size
    side = 1 << int(np.ceil(np.log2(max(height, width))))
    colours = [tuple(rng.uniform(0, 255, 3)) for _ in range(2)]
    return image(ramp(cloud(rng, side, float(rng.uniform(0.8, 2.2)))[:height, :width], colours))


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    a, b, c = np.asarray(values, float).tolist()
    return a, b, c
