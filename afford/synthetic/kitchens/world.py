"""World of a clip: room, people, objects and animation of a SceneSpec, evaluated at any time."""

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
from afford.synthetic.kitchens.animation import DURATION, Animation, ArmMotion, GripInterval, SceneObject
from afford.synthetic.kitchens.epic_files import hand_entities
from afford.synthetic.kitchens.rooms import Room, build_room, place_mats
from afford.synthetic.kitchens.scene_builder import CENTRE, SceneBuilder
from afford.synthetic.kitchens.scripts import STRONG_PARALLAX, script
from afford.synthetic.kitchens.vocabulary import noun_class
from schemas.masks import Entity
from schemas.scene import SceneSpec
from schemas.video import SIDES


class FingerTrajectory:
    """Finger joint angles (20,) of an arm over time: open on approach, closed on the object that it holds."""

    def __init__(self, arm: ArmMotion) -> None:
        self.arm = arm
        self._closed = [close_fingers(interval) for interval in arm.grip_intervals]

    def at(self, time: float) -> np.ndarray:
        """Return the joint angles (20,) at a time, radians."""
        if not self.arm.grip_intervals:
            return posture("relaxed")
        weights = np.array([_contact_weight(interval, time) for interval in self.arm.grip_intervals])
        weights /= weights.sum()
        amount = float(self.arm.closed.at(time)[0])
        opened = np.array([opening_posture(interval.grip.kind) for interval in self.arm.grip_intervals])
        return weights @ (opened + amount * (np.array(self._closed) - opened))


def close_fingers(interval: GripInterval) -> np.ndarray:
    """Return the joint angles (20,) at which the fingers rest on the held object, radians."""
    grip, model = interval.grip, interval.obj.model
    shapes = [part.mesh for part in model.parts]
    return close_on(grip.kind, distance_to(merge(*shapes), np.linalg.inv(grip.T_obj_palm), grip.side))


def _contact_weight(interval: GripInterval, time: float) -> float:
    gap = max(interval.start - time, time - interval.stop, 0.0)
    return float(np.exp(-((gap / 6.0) ** 2))) + 1e-6


WIDTH, HEIGHT = 456, 256
FIELD_OF_VIEW_DEG = 56.0
HOMES = {"left": np.array([-0.24, -0.21, 0.11]), "right": np.array([0.24, -0.21, 0.11])}
EYE = np.array([0.0, -0.16, 0.50])


@dataclass(frozen=True)
class World:
    """Elements of one clip. Entities 0 and 1 are the hands; the objects follow in the order of their names."""

    animation: Animation
    room: Room
    hands: tuple[HandModel, HandModel]
    fingers: tuple[FingerTrajectory, FingerTrajectory]
    entities: tuple[Entity, ...]
    objects: tuple[SceneObject, ...]
    K: np.ndarray

    @cached_property
    def textures(self) -> Textures:
        """Textures of all instances."""
        return Textures.of(instance.material for instance in self.instances(0.0))

    def camera(self, time: float) -> Camera:
        """Return the camera at a time."""
        return Camera(self.K, self.animation.head.at(time), WIDTH, HEIGHT)

    def instances(self, time: float) -> list[Instance]:
        """Return all instances at a time."""
        out = list(self.room.instances)
        for number, obj in enumerate(self.objects):
            out += obj.model.instances(obj.at(time), number + 2, float(obj.opened.at(time)[0]))
        for number, side in enumerate(SIDES):
            palm = self.animation.arms[side].track.at(time)
            angles = self.fingers[number].at(time)
            out += self.hands[number].instances(palm, angles, elbow(side, palm), number)
        return out

    def contacts(self, time: float) -> tuple[int, int]:
        """Return the index of the entity that the (left, right) hand touches at a time, -1 for none."""
        touches = [self.animation.arms[side].grip_at(time) for side in SIDES]
        left, right = (-1 if interval is None else self.objects.index(interval.obj) + 2 for interval in touches)
        return left, right


def elbow(side: str, palm: np.ndarray) -> np.ndarray:
    """Return the position of an elbow (3,), world metres: beside the body, shifted with the hand."""
    rest = HOMES[side] + (0.06 if side == "right" else -0.06, -0.23, 0.07)
    return rest + 0.35 * (palm[:3, 3] - HOMES[side]) * (1, 1, 0.6)


def build_world(spec: SceneSpec) -> World:
    """Build the world of a spec, deterministically. Raises ValueError for an unknown script or setting."""
    rng = random_stream(spec)
    return _furnish(spec, build_animation(spec, rng), rng)


def random_stream(spec: SceneSpec) -> np.random.Generator:
    """Return the random generator of a spec."""
    return np.random.default_rng([spec.seed, zlib.crc32(f"{spec.setting}/{spec.script}".encode())])


def build_animation(spec: SceneSpec, rng: np.random.Generator) -> Animation:
    """Run the script of a spec. Raises ValueError for an unknown script."""
    run = script(spec.script)
    style = PARALLAX if spec.script in STRONG_PARALLAX else CALM
    head = Head(rng, style, EYE + rng.uniform(-0.03, 0.03, 3), DURATION)
    animation = Animation(head, {side: ArmMotion(side, palm_frame(HOMES[side], (0, 0, -1), (0, 1, 0))) for side in SIDES})
    run(SceneBuilder(rng, animation, spec.setting, spec.key_gap * DURATION / spec.frames))
    return animation


def _furnish(spec: SceneSpec, animation: Animation, rng: np.random.Generator) -> World:
    objects = tuple(sorted(animation.objects, key=lambda obj: obj.name))
    entities = tuple(Entity(t.name, t.name, noun_class(t.model.noun).id, "object", "") for t in objects)
    room = build_room(spec.setting, rng)
    room = replace(room, instances=(*room.instances, *place_mats(spec.setting, rng, CENTRE)))
    look = random_person(rng)
    pair = (HandModel.build("left", look), HandModel.build("right", look))
    fingers = (FingerTrajectory(animation.arms["left"]), FingerTrajectory(animation.arms["right"]))
    return World(
        animation, room, pair, fingers, (*hand_entities(), *entities), objects, intrinsics(WIDTH, HEIGHT, FIELD_OF_VIEW_DEG)
    )
