"""World of a StillSpec: a room, its pool of objects and one person, and random layouts of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from afford.render.mesh import merge
from afford.render.motion import axis_angle, pose
from afford.render.scene import BACKGROUND, Instance, Light, Textures
from afford.synthetic.assets import library
from afford.synthetic.assets.object_model import ObjectModel
from afford.synthetic.human_hand.appearance import random_person
from afford.synthetic.human_hand.hand_model import HandModel
from afford.synthetic.human_hand.skeleton import close_on, distance_to
from afford.synthetic.kitchens import rooms
from afford.synthetic.kitchens.rooms import place_mats
from afford.synthetic.kitchens.scene_builder import CENTRE
from afford.synthetic.kitchens.world import elbow
from afford.synthetic.splits import NEW_KINDS, object_kinds
from afford.synthetic.stills.grasp_options import GripOption, with_extra_grips
from afford.synthetic.stills.table_layout import PlacedObject, place_on_table
from schemas.scene import StillSpec
from schemas.video import SIDES

POOL = 9
"""Number of objects of a room; a layout shows some of them."""
ON_TABLE = (4, 7)
BEHIND = 3
SURFACE_POINTS, CLOSING_STEPS = 1500, 14
"""Surface points and steps for closing fingers on an object, enough for a hand at this image size."""
TINT = (0.72, 1.12)
"""Range of the factor by which the colours of an object are multiplied in each layout."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Objects on the table, lighting, and all instances of a layout."""

    objects: tuple[PlacedObject, ...]
    light: Light
    instances: tuple[Instance, ...]


class StillWorld:
    """One room, its objects and one person."""

    def __init__(self, spec: StillSpec) -> None:
        self.spec, self.rng = spec, np.random.default_rng(spec.seed)
        self.models = [with_extra_grips(library.build(kind, self.rng)) for kind in self._pool()]
        room = rooms.build_empty(spec.setting, self.rng)
        self.room = replace(room, instances=(*room.instances, *place_mats(spec.setting, self.rng, CENTRE)))
        look = random_person(self.rng)
        self.hands: dict[str, HandModel] = {side: HandModel.build(side, look) for side in SIDES}
        shown = [part.material for model in self.models for part in model.parts]
        self.textures = Textures.of([*shown, *(instance.material for instance in self.room.instances)])
        self._closed: dict[tuple[int, str, str, str, int], np.ndarray] = {}

    def _pool(self) -> list[str]:
        """Choose the kinds of the room's objects, with distinct nouns."""
        allowed = object_kinds(self.spec.setting, self.spec.asks, self.spec.split)
        order = [str(kind) for kind in self.rng.permutation(allowed)]
        if self.spec.asks == "new":
            order = [*NEW_KINDS, *(kind for kind in order if kind not in (*NEW_KINDS, "bottle"))]
        return order[:POOL]

    def layout(self) -> Layout:
        """Sample a layout: some objects on the table, others at the back."""
        rng = self.rng
        order = [self.models[k] for k in rng.permutation(len(self.models))]
        if self.spec.asks == "new":
            order.sort(key=lambda model: model.kind not in NEW_KINDS)
        count = int(rng.integers(*ON_TABLE))
        objects = place_on_table(order[:count], rng)
        behind = self._behind(order[count : count + BEHIND])
        shown = [_tinted(instance, rng) for instance in [*self.room.instances, *behind]]
        for obj in objects:
            factor = rng.uniform(*TINT, 3)
            shown += [_with_tint(instance, factor) for instance in obj.model.instances(obj.T_world_obj, obj.number)]
        return Layout(tuple(objects), _relit(self.room.light, rng), tuple(shown))

    def _behind(self, models: Sequence[ObjectModel]) -> list[Instance]:
        places = self.rng.permutation(np.linspace(-0.55, 0.55, 6))[: len(models)]
        out: list[Instance] = []
        for model, x in zip(models, places, strict=True):
            at = (x, float(self.rng.uniform(0.62, 0.70)), 0.0)
            out += model.instances(pose(at, axis_angle((0, 0, 1), self.rng.uniform(-0.8, 0.8))), BACKGROUND)
        return out

    def hand(self, option: GripOption) -> list[Instance]:
        """Return the instances of a hand on an object."""
        return self.hands[option.side].instances(option.palm, self.fingers(option), elbow(option.side, option.palm), 0)

    def fingers(self, option: GripOption) -> np.ndarray:
        """Return the joint angles (20,) closed on the object, shared by all rotations of a rotationally symmetric object."""
        model, grip = option.obj.model, option.grip
        key = (id(model), grip.name, grip.kind, *(("", 0) if model.spins else (grip.side, option.turn)))
        if key not in self._closed:
            shape = merge(*(part.mesh for part in model.parts))
            distance = distance_to(shape, np.linalg.inv(grip.T_obj_palm), grip.side, samples=SURFACE_POINTS)
            self._closed[key] = close_on(grip.kind, distance, CLOSING_STEPS)
        return self._closed[key]


def _tinted(instance: Instance, rng: np.random.Generator) -> Instance:
    return _with_tint(instance, rng.uniform(*TINT, 3))


def _with_tint(instance: Instance, factor: np.ndarray) -> Instance:
    return replace(instance, material=replace(instance.material, tint=_triple(np.asarray(instance.material.tint) * factor)))


def _relit(light: Light, rng: np.random.Generator) -> Light:
    """Sample other lighting of a room: side and brightness of the lamp."""
    x, y, z = light.direction
    turned = axis_angle((0, 0, 1), rng.uniform(-0.5, 0.5)) @ np.array([x * rng.choice([-1.0, 1.0]), y, z])
    power = rng.uniform(0.85, 1.15)
    return replace(light, direction=_triple(turned), colour=_triple(np.asarray(light.colour) * power))


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    a, b, c = values.tolist()
    return a, b, c
