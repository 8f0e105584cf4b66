"""Images of people whose hands hold objects, reach or are absent, with a label for every pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from afford.render.draw import render
from afford.render.motion import Pose, axis_angle, pose
from afford.render.scene import BACKGROUND, Instance, Textures
from afford.synthetic.kitchens.scene_builder import CENTRE
from afford.synthetic.kitchens.world import elbow
from afford.synthetic.sensor import add_image_noise
from afford.synthetic.stills.grasp_options import GripOption, ReachModel
from afford.synthetic.stills.hand_scenes import PersonModel, backdrop, free_hand_pose, hands_apart, relight, sample_camera
from afford.synthetic.stills.still_world import Layout, StillWorld
from schemas.scene import LEFT_HAND, REST, RIGHT_HAND, SLEEVE, TOUCHED, HandLessons, HandRoom, StillSpec
from schemas.video import SIDES

PEOPLE, VIEWS = 4, 4
"""people in a room; images of each layout of its objects"""
HANDS_SHARE = (0.15, 0.35, 0.5)
"""share of images with no hand, one hand and two hands"""
HOLDS, LIFTS = 0.6, 0.4
"""share of hands that hold an object where possible; share of held objects that are lifted"""
ENTITY = {"left": 100, "right": 101}
CLOTH = 102
"""entity ids of hands and sleeves, above those of objects"""


@dataclass(frozen=True, eq=False)
class HandAction:
    """Pose of one hand, and the object that it holds."""

    side: str
    palm: Pose
    angles: np.ndarray
    held: int | None = None
    """number of the held object"""
    moved: Pose | None = None
    """motion of the held object from its pose on the table"""


def render_hand_images(room: HandRoom, count: int, size: tuple[int, int], supersample: int,
            progress: Callable[[int, int], None]) -> HandLessons:  # fmt: skip
    """Render `count` labelled images of `size` (width, height)."""
    world, rng = StillWorld(_spec(room)), np.random.default_rng([room.seed, 1])
    people = [PersonModel.sample(rng) for _ in range(PEOPLE)]
    textures = _textures(world, people)
    pictures, labels = np.zeros((count, size[1], size[0], 3), np.uint8), np.zeros((count, size[1], size[0]), np.uint8)
    for n in range(count):
        if n % VIEWS == 0:
            layout = world.layout()
        one = people[int(rng.integers(PEOPLE))]
        pictures[n], labels[n] = _render_image(one, _hand_actions(world, layout, rng), layout, textures, size, supersample, rng)
        progress(n + 1, count)
    return HandLessons(room.name, room.split, pictures, labels)


def _spec(room: HandRoom) -> StillSpec:
    return StillSpec(room.name, room.setting, room.seed, room.split, "any" if room.setting != "kitchen" else "known", 1, 1, 1)


def _textures(world: StillWorld, people: list[PersonModel]) -> Textures:
    looks = [hand.look for one in people for hand in one.hands.values()]
    worn = [look for one in looks for look in (one.skin, one.cloth, one.worn_look) if look is not None]
    parts = [part.material for model in world.models for part in model.parts]
    return Textures.of([*parts, *(instance.material for instance in world.room.instances), *worn])


def _hand_actions(world: StillWorld, layout: Layout, rng: np.random.Generator) -> list[HandAction]:
    """Sample the actions of the hands in an image. A second hand that would collide with the first is left out."""
    count = int(rng.choice(3, p=HANDS_SHARE))
    reach, out = ReachModel(layout.objects), list[HandAction]()
    for side in rng.permutation(SIDES)[:count]:
        action = _hand_action(world, layout, reach, str(side), [done.held for done in out], rng)
        if hands_apart([done.palm for done in (*out, action)]):
            out.append(action)
    return out


def _hand_action(world: StillWorld, layout: Layout, reach: ReachModel, side: str, taken: list[int | None],
                 rng: np.random.Generator) -> HandAction:  # fmt: skip
    if rng.random() < HOLDS and layout.objects:
        obj = layout.objects[int(rng.integers(len(layout.objects)))]
        options = reach.options(obj, side)
        if options:
            return _hold_action(world, options[int(rng.integers(len(options)))], obj.number not in taken, rng)
    return HandAction(side, *free_hand_pose(side, rng))


def _hold_action(world: StillWorld, option: GripOption, free: bool, rng: np.random.Generator) -> HandAction:
    """Place a hand on an object, which may be lifted and tilted unless the other hand holds it as well."""
    up = np.eye(4)
    if free and rng.random() < LIFTS:
        middle = option.palm[:3, 3]
        tilt = axis_angle(rng.normal(size=3), float(rng.normal(0, 0.25)))
        up = pose(middle + (*rng.uniform(-0.04, 0.04, 2), rng.uniform(0.02, 0.16)), tilt) @ pose(-middle)
    return HandAction(option.side, up @ option.palm, world.fingers(option), option.obj.number, up)


def _render_image(one: PersonModel, actions: list[HandAction], layout: Layout, textures: Textures, size: tuple[int, int],
                  supersample: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Render an image (h, w, 3) uint8 and its labels (h, w) uint8."""
    palms = [action.palm[:3, 3] for action in actions] or [np.array([*CENTRE, 0.04])]
    camera, turned = sample_camera(palms[int(rng.integers(len(palms)))], size, rng)
    shown = [_move_held(instance, actions) for instance in layout.instances]
    shown += [instance for action in actions for instance in _arm_instances(one, action)]
    seen = render([*shown, *one.body], camera, relight(layout.light, rng), textures, supersample=supersample)
    rgb = np.where((seen.depth_m > 0)[..., None], seen.rgb, backdrop(size, rng))
    label = _labels(seen.ids, actions)
    rgb, label = (rgb[::-1, ::-1], label[::-1, ::-1]) if turned else (rgb, label)
    return add_image_noise(rgb, rng), label


def _move_held(instance: Instance, actions: list[HandAction]) -> Instance:
    for action in actions:
        if instance.entity != BACKGROUND and instance.entity == action.held and action.moved is not None:
            instance = replace(instance, T_world_mesh=action.moved @ instance.T_world_mesh)
    return instance


def _arm_instances(one: PersonModel, action: HandAction) -> list[Instance]:
    """Return the instances of an arm: skin and watch labelled as the hand, the sleeve as cloth."""
    hand = one.hands[action.side]
    drawn = hand.instances(action.palm, action.angles, elbow(action.side, action.palm), ENTITY[action.side])
    return [replace(i, entity=CLOTH) if i.mesh is hand.sleeve else i for i in drawn]


def _labels(ids: np.ndarray, actions: list[HandAction]) -> np.ndarray:
    out = np.full(ids.shape, REST, np.uint8)
    for entity, label in ((ENTITY["left"], LEFT_HAND), (ENTITY["right"], RIGHT_HAND), (CLOTH, SLEEVE)):
        out[ids == entity] = label
    for action in actions:
        if action.held is not None:
            out[ids == action.held] = TOUCHED
    return out
