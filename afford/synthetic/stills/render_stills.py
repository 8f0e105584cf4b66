"""A layout seen by a camera: its picture, the complete mask of every thing, and the visible mask of a hand put into it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from afford.common.image_files import encode_jpeg
from afford.render.camera import intrinsics, look_at
from afford.render.draw import draw_ids, render
from afford.render.raster import edges, fill, project
from afford.render.scene import Camera, Instance
from afford.synthetic.kitchens.epic_files import narration
from afford.synthetic.kitchens.scene_builder import CENTRE, plain_name
from afford.synthetic.kitchens.world import EYE
from afford.synthetic.sensor import add_image_noise
from afford.synthetic.splits import is_asked, is_new
from afford.synthetic.stills.grasp_options import GraspPlan, GripOption, ReachModel, grasp_plans, plan_weights
from afford.synthetic.stills.still_world import Layout, StillWorld
from afford.synthetic.stills.task_catalogue import Task, tasks_for
from schemas.scene import Mode, Picture, Still, Stills, StillSpec
from schemas.video import Narration

EYE_SPREAD_M = np.array([0.07, 0.05, 0.06])
GAZE_SPREAD_M = np.array([0.05, 0.04, 0.02])
FIELD_OF_VIEW_DEG = (52.0, 60.0)
ROLL_RAD = 0.06


@dataclass(frozen=True)
class ImageSizes:
    """Width and height of the picture and of its masks, px; both show the same."""

    image: tuple[int, int]
    mask: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Shot:
    """One picture and what is needed to put masks on it."""

    rgb: np.ndarray
    """(h, w, 3) uint8 without hands"""
    camera: Camera
    """camera of the masks"""
    ids: np.ndarray
    """(mask h, mask w) int16 number of the thing seen, -1 elsewhere"""
    nearness: np.ndarray
    """(mask h, mask w) float32 1 / depth of what is seen, 0 for nothing"""

    def complete(self, instances: Sequence[Instance]) -> np.ndarray:
        """(h, w) bool: all pixels of these, whatever stands before them."""
        return _drawn(instances, self.camera, np.zeros_like(self.nearness))[1]

    def hands(self, world: StillWorld, ways: tuple[GripOption | None, GripOption | None]) -> np.ndarray:
        """(2, h, w) bool: visible pixels of the (left, right) hand, arm and sleeve, as it takes hold."""
        out, near = np.zeros((2, *self.nearness.shape), np.bool_), self.nearness
        for side, way in enumerate(ways):
            if way is not None:
                near, out[side] = _drawn(world.hand(way), self.camera, near)
                out[:side] &= ~out[side]
        return out


def take_picture(world: StillWorld, layout: Layout, sizes: ImageSizes, supersample: int) -> Shot:
    """Take a picture of a layout with a head that looks at the table from somewhere else each time."""
    rng = world.rng
    eye = EYE + rng.uniform(-1, 1, 3) * EYE_SPREAD_M
    gaze = np.array([*CENTRE, 0.04]) + rng.uniform(-1, 1, 3) * GAZE_SPREAD_M
    T, view_deg = look_at(eye, gaze, float(rng.uniform(-ROLL_RAD, ROLL_RAD))), float(rng.uniform(*FIELD_OF_VIEW_DEG))
    seen = render(layout.instances, _camera(T, sizes.image, view_deg), layout.light, world.textures, supersample=supersample)
    camera = _camera(T, sizes.mask, view_deg)
    same = sizes.mask == sizes.image
    ids, depth = (seen.ids, seen.depth_m) if same else draw_ids(layout.instances, camera, world.textures)
    nearness = np.where(depth > 0, 1.0 / np.maximum(depth, 1e-9), 0.0).astype(np.float32)
    return Shot(add_image_noise(seen.rgb, rng), camera, ids, nearness)


def _camera(T_world_cam: np.ndarray, size: tuple[int, int], view_deg: float) -> Camera:
    return Camera(intrinsics(*size, view_deg), T_world_cam, *size)


def _drawn(instances: Sequence[Instance], camera: Camera, nearness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nearness (h, w) with the instances drawn on top, and (h, w) bool where they are seen."""
    near, face = nearness.copy(), np.full(nearness.shape, -1, np.int32)
    for one in instances:
        points = one.vertices if one.vertices is not None else _moved(one)
        E, bounds = edges(project(points, camera), one.mesh.faces, camera.width, camera.height)
        fill(E, bounds, 0, len(one.mesh.faces), 1, near, face)
    return near, face >= 0


def _moved(instance: Instance) -> np.ndarray:
    T = instance.T_world_mesh.astype(np.float32)
    return np.asarray(instance.mesh.vertices @ T[:3, :3].T + T[:3, 3], np.float32)


LEAST_AREA = 0.0005
"""A smaller affordance, as a share of the picture, is no lesson."""
LEAST_SEEN = 0.55
"""Share of a thing that must be in sight for it to be asked for."""
SAME = 0.8
"""Two ways whose masks overlap so much (IoU) look the same."""


@dataclass(frozen=True)
class RenderQuality:
    """How pictures are made and kept."""

    sizes: ImageSizes
    supersample: int
    jpeg_quality: int


def render_stills(spec: StillSpec, quality: RenderQuality, progress: Callable[[int, int], None]) -> Stills:
    """All stills of a spec."""
    world = StillWorld(spec)
    images: list[Picture] = []
    found: list[Still] = []
    for _ in range(spec.layouts):
        layout = world.layout()
        reach, names = ReachModel(layout.things), {thing.number: plain_name(thing.model.noun) for thing in layout.things}
        wanted = [act for act in tasks_for(layout.things, names) if is_asked(spec.asks, is_new(act.verb, act.kinds))]
        for _ in range(spec.views):
            shot = take_picture(world, layout, quality.sizes, quality.supersample)
            for act, modes in _asked(world, layout, shot, reach, wanted):
                number = len(found) + 1
                said = _said(spec.video_id, number, act)
                found.append(Still(number, len(images), said, act.kinds, is_new(act.verb, act.kinds), modes))
            images.append(Picture(encode_jpeg(shot.rgb, quality.jpeg_quality)))
            progress(len(images), spec.layouts * spec.views)
    width, height = quality.sizes.image
    person = spec.video_id.rpartition("_")[0]
    return Stills(spec.video_id, person, spec.split, spec.setting, width, height, tuple(images), tuple(found))


Asked = tuple[Task, tuple[Mode, ...]]


def _asked(world: StillWorld, layout: Layout, shot: Shot, reach: ReachModel, wanted: list[Task]) -> Iterator[Asked]:
    """Up to `spec.tasks` tasks of one picture, one per verb and things, with their modes; what cannot be done is left out."""
    seen = _in_sight(layout, shot)
    for act in _by_turns([act for act in wanted if all(thing.number in seen for thing in act.things)], world.rng, world.spec.tasks):
        modes = _modes(world, shot, grasp_plans(act, reach), seen)
        if modes:
            yield act, modes


def _by_turns(wanted: list[Task], rng: np.random.Generator, most: int) -> list[Task]:
    """At most `most` acts, no verb with the same things twice: those that may take two hands and those that take one by turns,
    and among these every verb with the same chance.
    """
    groups: dict[bool, dict[tuple[str, int], list[Task]]] = {True: {}, False: {}}
    for k in rng.permutation(len(wanted)):
        act = wanted[k]
        groups[act.support is not None].setdefault((act.verb, len(act.things)), []).append(act)
    chosen: dict[tuple[object, ...], Task] = {}
    two = bool(rng.random() < 0.5)
    while len(chosen) < most and any(groups.values()):
        two = not two if groups[not two] else two
        names = list(groups[two])
        name = names[int(rng.integers(len(names)))]
        act = groups[two][name].pop()
        if not groups[two][name]:
            del groups[two][name]
        chosen.setdefault((act.verb, *(thing.number for thing in act.things)), act)
    return list(chosen.values())


def _in_sight(layout: Layout, shot: Shot) -> dict[int, np.ndarray]:
    """Complete masks (h, w) of the things that can be recognised, by number."""
    out = {}
    for thing in layout.things:
        mask = shot.complete(thing.model.instances(thing.T_world_obj, thing.number))
        if mask.any() and np.count_nonzero(shot.ids == thing.number) > LEAST_SEEN * np.count_nonzero(mask):
            out[thing.number] = mask
    return out


def _modes(world: StillWorld, shot: Shot, chosen: list[GraspPlan], complete: dict[int, np.ndarray]) -> tuple[Mode, ...]:
    """The plans as masks; those that cannot be seen well or that look like a more comfortable one are left out."""
    kept: list[tuple[GraspPlan, np.ndarray]] = []
    for plan in chosen:
        masks = _masks(world, shot, plan, complete)
        if _shows(plan, masks) and not any(plan.taxonomy == p.taxonomy and _iou(masks, m) > SAME for p, m in kept):
            kept.append((plan, masks))
    if not kept:
        return ()
    shares = plan_weights(plan for plan, _ in kept)
    return tuple(_mode(plan, masks, float(share)) for (plan, masks), share in zip(kept, shares, strict=True))


def _masks(world: StillWorld, shot: Shot, plan: GraspPlan, complete: dict[int, np.ndarray]) -> np.ndarray:
    """(4, h, w) bool: affordance left, right = complete object AND visible hand; complete object left, right."""
    hands = shot.hands(world, plan.ways)
    empty = np.zeros_like(hands[0])
    things = np.stack([complete[way.thing.number] if way else empty for way in plan.ways])
    return np.concatenate([hands & things, things])


def _shows(plan: GraspPlan, masks: np.ndarray) -> bool:
    """Whether every hand that takes part is seen well enough on its thing, and not at the border of the picture."""
    for way, mask in zip(plan.ways, masks, strict=False):
        cut = mask[[0, -1]].any() or mask[:, [0, -1]].any()
        if way is not None and (cut or np.count_nonzero(mask) < LEAST_AREA * mask.size):
            return False
    return True


def _iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a[:2] & b[:2]).sum() / max(int((a[:2] | b[:2]).sum()), 1))


def _mode(plan: GraspPlan, masks: np.ndarray, weight: float) -> Mode:
    left, right = ((plain_name(way.thing.model.noun), way.grip.name) if way else ("", "") for way in plan.ways)
    return Mode(masks, (left[0], right[0]), (left[1], right[1]), plan.taxonomy, weight)


def _said(video_id: str, number: int, act: Task) -> Narration:
    """The narration; its nouns in the order in which they are said."""
    nouns = sorted((thing.model.noun for thing in act.things), key=lambda noun: act.text.find(plain_name(noun)))
    return narration(video_id, number, (number, number), act.text, act.verb, tuple(nouns))
