"""A SceneSpec made into a world: room, people, things and their play; and what of it is there at one moment."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from afford.render.camera import CALM, PARALLAX, Head, intrinsics
from afford.render.mesh import merge
from afford.render.scene import Camera, Instance, Textures
from afford.synthetic.assets.object_model import palm_frame
from afford.synthetic.human_hand.appearance import random_person
from afford.synthetic.human_hand.hand_model import HandModel
from afford.synthetic.human_hand.skeleton import close_on, distance_to, opening_posture, posture
from afford.synthetic.kitchens.animation import LENGTH, Arm, Play, Thing, Touch
from afford.synthetic.kitchens.epic_files import hand_entities
from afford.synthetic.kitchens.rooms import Room, place_mats
from afford.synthetic.kitchens.rooms import build as build_room
from afford.synthetic.kitchens.scene_builder import CENTRE, Cast
from afford.synthetic.kitchens.scripts import STRONG_PARALLAX, script
from afford.synthetic.kitchens.vocabulary import noun_class
from schemas.masks import Entity
from schemas.scene import SceneSpec
from schemas.video import SIDES


class FingerTrajectory:
    """Joint angles (20,) of the hand of an arm at any time."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self._closed = [close_fingers(touch) for touch in arm.touches]

    def at(self, time: float) -> np.ndarray:
        """Joint angles in radians at a play time."""
        if not self.arm.touches:
            return posture("relaxed")
        weights = np.array([_contact_weight(touch, time) for touch in self.arm.touches])
        weights /= weights.sum()
        amount = float(self.arm.closed.at(time)[0])
        opened = np.array([opening_posture(touch.grip.kind) for touch in self.arm.touches])
        return weights @ (opened + amount * (np.array(self._closed) - opened))


def close_fingers(touch: Touch) -> np.ndarray:
    """The angles (20,) at which the fingers rest on what is held."""
    grip, model = touch.grip, touch.thing.model
    shapes = [part.mesh for part in model.parts]
    return close_on(grip.kind, distance_to(merge(*shapes), np.linalg.inv(grip.T_obj_palm), grip.side))


def _contact_weight(touch: Touch, time: float) -> float:
    gap = max(touch.start - time, time - touch.stop, 0.0)
    return float(np.exp(-((gap / 6.0) ** 2))) + 1e-6


WIDTH, HEIGHT = 456, 256
FIELD_OF_VIEW_DEG = 56.0
HOMES = {"left": np.array([-0.24, -0.21, 0.11]), "right": np.array([0.24, -0.21, 0.11])}
EYE = np.array([0.0, -0.16, 0.50])


@dataclass(frozen=True)
class World:
    """Everything of one clip. Entities 0 and 1 are the hands, then the things in the order of their names."""

    play: Play
    room: Room
    hands: tuple[HandModel, HandModel]
    fingers: tuple[FingerTrajectory, FingerTrajectory]
    entities: tuple[Entity, ...]
    things: tuple[Thing, ...]
    K: np.ndarray

    @cached_property
    def textures(self) -> Textures:
        """The images of everything that is drawn."""
        return Textures.of(instance.material for instance in self.instances(0.0))

    def camera(self, time: float) -> Camera:
        """The camera at a play time."""
        return Camera(self.K, self.play.head.at(time), WIDTH, HEIGHT)

    def instances(self, time: float) -> list[Instance]:
        """All that can be seen at a play time."""
        out = list(self.room.instances)
        for number, thing in enumerate(self.things):
            out += thing.model.instances(thing.at(time), number + 2, float(thing.opened.at(time)[0]))
        for number, side in enumerate(SIDES):
            palm = self.play.arms[side].track.at(time)
            angles = self.fingers[number].at(time)
            out += self.hands[number].instances(palm, angles, elbow(side, palm), number)
        return out

    def touched(self, time: float) -> tuple[int, int]:
        """Entity that the (left, right) hand touches, -1 for none."""
        touches = [self.play.arms[side].touch_at(time) for side in SIDES]
        left, right = (-1 if touch is None else self.things.index(touch.thing) + 2 for touch in touches)
        return left, right


def elbow(side: str, palm: np.ndarray) -> np.ndarray:
    """Where the elbow of an arm is, (3,) world metres: beside the body, drawn along by the hand."""
    rest = HOMES[side] + (0.06 if side == "right" else -0.06, -0.23, 0.07)
    return rest + 0.35 * (palm[:3, 3] - HOMES[side]) * (1, 1, 0.6)


def build_world(spec: SceneSpec) -> World:
    """The world of a spec; the same spec gives the same world. ValueError for an unknown script or setting."""
    rng = np.random.default_rng([spec.seed, zlib.crc32(f"{spec.setting}/{spec.script}".encode())])
    act = script(spec.script)
    style = PARALLAX if spec.script in STRONG_PARALLAX else CALM
    head = Head(rng, style, EYE + rng.uniform(-0.03, 0.03, 3), LENGTH)
    play = Play(head, {side: Arm(side, palm_frame(HOMES[side], (0, 0, -1), (0, 1, 0))) for side in SIDES})
    act(Cast(rng, play, spec.setting, spec.key_gap * LENGTH / spec.frames))
    return _furnish(spec, play, rng)


def _furnish(spec: SceneSpec, play: Play, rng: np.random.Generator) -> World:
    things = tuple(sorted(play.things, key=lambda thing: thing.name))
    objects = tuple(Entity(t.name, t.name, noun_class(t.model.noun).id, "object", "") for t in things)
    room = build_room(spec.setting, rng)
    room = replace(room, instances=(*room.instances, *place_mats(spec.setting, rng, CENTRE)))
    look = random_person(rng)
    pair = (HandModel.build("left", look), HandModel.build("right", look))
    fingers = (FingerTrajectory(play.arms["left"]), FingerTrajectory(play.arms["right"]))
    return World(play, room, pair, fingers, (*hand_entities(), *objects), things, intrinsics(WIDTH, HEIGHT, FIELD_OF_VIEW_DEG))
