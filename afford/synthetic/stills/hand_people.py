"""People for lessons about hands: any sleeve, two hands, a body; and what their hands do, on a thing or in the air."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from afford.render.mesh import moved
from afford.render.motion import Pose, about, pose
from afford.render.scene import BACKGROUND, Instance
from afford.render.solids import lathe
from afford.synthetic.kitchens.world import elbow
from afford.synthetic.people.hand import HandModel
from afford.synthetic.people.hand_bones import HIGH, LOW
from afford.synthetic.people.hand_grasp import CLOSED, OPENING, POSTURES
from afford.synthetic.people.hand_look import HandLook, person
from afford.synthetic.people.hand_shape import ARM_M
from afford.synthetic.things.asset import palm_frame
from schemas.video import SIDES

CUFF_M = (0.0, 0.35)
"""where sleeves end, from the wrist back"""
BARE, BARE_GLOVES = 0.3, 0.25
"""share of people without sleeves; share of gloved people who keep their gloves"""
REACH_M = ((-0.14, 0.32), (0.0, 0.52), (0.015, 0.26))
"""where the palm of a hand in the air may be: to its own side, away from the person, above the table"""
TURN_RAD, PITCH = 0.7, 0.45
"""how far fingers point aside from the forearm, and how steeply down or up"""
PALM_RAD = (-0.5, 2.0)
"""how far a palm is turned: 0 down, pi / 2 to the other hand"""
NEAREST_M = 0.09
"""palms of two hands are at least so far apart"""


@dataclass(frozen=True, eq=False)
class Person:
    """Two hands, and head and trunk for who looks from across the table."""

    hands: dict[str, HandModel]
    body: tuple[Instance, ...]

    @staticmethod
    def of(rng: np.random.Generator) -> Person:
        """Somebody."""
        look = dressed(rng)
        return Person({side: HandModel.build(side, look) for side in SIDES}, _body(look, rng))


def dressed(rng: np.random.Generator) -> HandLook:
    """Hands with sleeves of any length, or none, and now and then gloves."""
    look = person(rng)
    while look.gloved and rng.random() > BARE_GLOVES:
        look = person(rng)
    return replace(look, cuff_m=ARM_M if rng.random() < BARE else float(rng.uniform(*CUFF_M)))


def in_the_air(side: str, rng: np.random.Generator) -> tuple[Pose, np.ndarray]:
    """A palm somewhere above the table and (20,) joint angles, as in reaching, showing or resting."""
    sign = 1.0 if side == "right" else -1.0
    at = np.array([rng.uniform(*span) for span in REACH_M]) * (sign, 1, 1)
    ahead = at - elbow(side, pose(at))
    ahead = about((0, 0, 1), rng.uniform(-TURN_RAD, TURN_RAD)) @ (ahead * (1, 1, 0.4))
    ahead = ahead / np.linalg.norm(ahead) + (0, 0, rng.uniform(-PITCH, PITCH))
    turn = rng.uniform(*PALM_RAD)
    palm = palm_frame(at, (-sign * np.sin(turn), 0.15, -np.cos(turn)), ahead)
    kinds = [*POSTURES.values(), *OPENING.values(), *CLOSED.values()]
    first, second = (np.array(kinds[int(rng.integers(len(kinds)))]) for _ in range(2))
    angles = first + (second - first) * rng.random() + rng.normal(0, 0.08, 20)
    return palm, np.clip(angles, LOW, HIGH)


def apart(palms: Sequence[Pose]) -> bool:
    """Whether hands at these palms do not run into each other."""
    return len(palms) < 2 or float(np.linalg.norm(palms[0][:3, 3] - palms[1][:3, 3])) >= NEAREST_M


def _body(look: HandLook, rng: np.random.Generator) -> tuple[Instance, ...]:
    """Trunk and head at the edge of the table: cloth, and skin that is no hand."""
    place = pose((float(rng.uniform(-0.05, 0.05)), -0.50, -0.45))
    trunk = lathe(np.array([(0.0, 0.0), (0.17, 0.0), (0.19, 0.45), (0.21, 0.80), (0.08, 0.92), (0.0, 0.93)]), 24, repeat_u=4.0)
    turn = np.linspace(-np.pi / 2, np.pi / 2, 12)
    head = moved(lathe(np.stack([0.085 * np.cos(turn), 0.12 * np.sin(turn)], 1), 20), 0.0, 0.04, 1.06)
    return Instance(trunk, look.cloth, place, BACKGROUND), Instance(head, look.skin, place, BACKGROUND)
