"""Rendering of a StillSpec: layouts, images without hands, tasks, and the masks of every grasp mode.

Affordance = complete object AND visible hand of the same side.
"""

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
from afford.synthetic.splits import accepts_task, is_held_out
from afford.synthetic.stills.grasp_options import GraspPlan, GripOption, ReachModel, grasp_plans, plan_weights
from afford.synthetic.stills.painters import Painter
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
    """Width and height of the image and of its masks, px; both have the same field of view."""

    image: tuple[int, int]
    mask: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Shot:
    """Image of a layout, with the depth buffer that masks are drawn into."""

    rgb: np.ndarray
    """(h, w, 3) uint8, without hands"""
    camera: Camera
    """camera of the masks"""
    ids: np.ndarray
    """(mask h, mask w) int16 number of the visible object, -1 elsewhere"""
    nearness: np.ndarray
    """(mask h, mask w) float32 inverse depth of the visible surface, 0 without a surface"""

    def complete(self, instances: Sequence[Instance]) -> np.ndarray:
        """Return the complete (amodal) mask (h, w) bool of these instances."""
        return _draw_over(instances, self.camera, np.zeros_like(self.nearness))[1]

    def hands(self, world: StillWorld, options: tuple[GripOption | None, GripOption | None]) -> np.ndarray:
        """Return the visible masks (2, h, w) bool of the left and right hand with arm and sleeve."""
        out, near = np.zeros((2, *self.nearness.shape), np.bool_), self.nearness
        for side, option in enumerate(options):
            if option is not None:
                near, out[side] = _draw_over(world.hand(option), self.camera, near)
                out[:side] &= ~out[side]
        return out


def take_picture(world: StillWorld, layout: Layout, sizes: ImageSizes, supersample: int, painter: Painter | None = None) -> Shot:
    """Render a layout from a random head pose. All painters show the same scenes, with the same masks."""
    rng = world.rng
    eye = EYE + rng.uniform(-1, 1, 3) * EYE_SPREAD_M
    gaze = np.array([*CENTRE, 0.04]) + rng.uniform(-1, 1, 3) * GAZE_SPREAD_M
    T, view_deg = look_at(eye, gaze, float(rng.uniform(-ROLL_RAD, ROLL_RAD))), float(rng.uniform(*FIELD_OF_VIEW_DEG))
    shown, camera = _camera(T, sizes.image, view_deg), _camera(T, sizes.mask, view_deg)
    if painter is None:
        seen = render(layout.instances, shown, layout.light, world.textures, supersample=supersample)
        rgb, maps = add_image_noise(seen.rgb, rng), (seen.ids, seen.depth_m) if sizes.mask == sizes.image else None
    else:
        rgb, maps = painter(layout, shown), None
        add_image_noise(np.zeros_like(rgb), rng)  # as many random numbers as above, so that the next scenes are the same
    ids, depth = maps or draw_ids(layout.instances, camera, world.textures)
    nearness = np.where(depth > 0, 1.0 / np.maximum(depth, 1e-9), 0.0).astype(np.float32)
    return Shot(rgb, camera, ids, nearness)


def _camera(T_world_cam: np.ndarray, size: tuple[int, int], view_deg: float) -> Camera:
    return Camera(intrinsics(*size, view_deg), T_world_cam, *size)


def _draw_over(instances: Sequence[Instance], camera: Camera, nearness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Draw instances into an inverse depth buffer (h, w); return it and the mask (h, w) bool of their visible pixels."""
    near, face = nearness.copy(), np.full(nearness.shape, -1, np.int32)
    for one in instances:
        points = one.vertices if one.vertices is not None else _world_vertices(one)
        E, bounds = edges(project(points, camera), one.mesh.faces, camera.width, camera.height)
        fill(E, bounds, 0, len(one.mesh.faces), 1, near, face)
    return near, face >= 0


def _world_vertices(instance: Instance) -> np.ndarray:
    T = instance.T_world_mesh.astype(np.float32)
    return np.asarray(instance.mesh.vertices @ T[:3, :3].T + T[:3, 3], np.float32)


MIN_AREA = 0.0005
"""Minimum area of an affordance, as a share of the image."""
MIN_VISIBLE = 0.55
"""Minimum visible share of an object that a task names."""
SAME_IOU = 0.8
"""Mask overlap (IoU) above which two plans count as the same mode."""


@dataclass(frozen=True)
class RenderQuality:
    """Image sizes, supersampling and JPEG quality."""

    sizes: ImageSizes
    supersample: int
    jpeg_quality: int


def render_stills(spec: StillSpec, quality: RenderQuality, progress: Callable[[int, int], None],
                  painter: Painter | None = None) -> Stills:  # fmt: skip
    """Render all stills of a spec, by default with the fast renderer."""
    world = StillWorld(spec)
    images: list[Picture] = []
    found: list[Still] = []
    for _ in range(spec.layouts):
        layout = world.layout()
        reach, names = ReachModel(layout.objects), {obj.number: plain_name(obj.model.noun) for obj in layout.objects}
        wanted = [task for task in tasks_for(layout.objects, names) if accepts_task(spec.asks, is_held_out(task.verb, task.kinds))]
        for _ in range(spec.views):
            shot = take_picture(world, layout, quality.sizes, quality.supersample, painter)
            for task, modes in _feasible_tasks(world, layout, shot, reach, wanted):
                number = len(found) + 1
                text = _task_narration(spec.video_id, number, task)
                found.append(Still(number, len(images), text, task.kinds, is_held_out(task.verb, task.kinds), modes))
            images.append(Picture(encode_jpeg(shot.rgb, quality.jpeg_quality)))
            progress(len(images), spec.layouts * spec.views)
    width, height = quality.sizes.image
    person = spec.video_id.rpartition("_")[0]
    return Stills(spec.video_id, person, spec.split, spec.setting, width, height, tuple(images), tuple(found))


TaskModes = tuple[Task, tuple[Mode, ...]]


def _feasible_tasks(world: StillWorld, layout: Layout, shot: Shot, reach: ReachModel, wanted: list[Task]) -> Iterator[TaskModes]:
    """Return up to `spec.tasks` feasible tasks of one image with their modes, at most one per verb and objects."""
    seen = _recognizable_masks(layout, shot)
    possible = [task for task in wanted if all(obj.number in seen for obj in task.objects)]
    for task in _balanced_sample(possible, world.rng, world.spec.tasks):
        modes = _modes(world, shot, grasp_plans(task, reach), seen)
        if modes:
            yield task, modes


def _balanced_sample(wanted: list[Task], rng: np.random.Generator, most: int) -> list[Task]:
    """Sample at most `most` tasks without repeating a verb with the same objects.

    Tasks that may take two hands alternate with one-handed tasks; within each group every verb is equally likely.
    """
    groups: dict[bool, dict[tuple[str, int], list[Task]]] = {True: {}, False: {}}
    for k in rng.permutation(len(wanted)):
        task = wanted[k]
        groups[task.support is not None].setdefault((task.verb, len(task.objects)), []).append(task)
    chosen: dict[tuple[object, ...], Task] = {}
    two = bool(rng.random() < 0.5)
    while len(chosen) < most and any(groups.values()):
        two = not two if groups[not two] else two
        names = list(groups[two])
        name = names[int(rng.integers(len(names)))]
        task = groups[two][name].pop()
        if not groups[two][name]:
            del groups[two][name]
        chosen.setdefault((task.verb, *(obj.number for obj in task.objects)), task)
    return list(chosen.values())


def _recognizable_masks(layout: Layout, shot: Shot) -> dict[int, np.ndarray]:
    """Return the complete masks (h, w) of the sufficiently visible objects, by number."""
    out = {}
    for obj in layout.objects:
        mask = shot.complete(obj.model.instances(obj.T_world_obj, obj.number))
        if mask.any() and np.count_nonzero(shot.ids == obj.number) > MIN_VISIBLE * np.count_nonzero(mask):
            out[obj.number] = mask
    return out


def _modes(world: StillWorld, shot: Shot, chosen: list[GraspPlan], complete: dict[int, np.ndarray]) -> tuple[Mode, ...]:
    """Convert plans to modes, without plans that are barely visible or look like a more comfortable one."""
    kept: list[tuple[GraspPlan, np.ndarray]] = []
    for plan in chosen:
        masks = _masks(world, shot, plan, complete)
        if _is_visible(plan, masks) and not any(plan.taxonomy == p.taxonomy and _iou(masks, m) > SAME_IOU for p, m in kept):
            kept.append((plan, masks))
    if not kept:
        return ()
    shares = plan_weights(plan for plan, _ in kept)
    return tuple(_mode(plan, masks, float(share)) for (plan, masks), share in zip(kept, shares, strict=True))


def _masks(world: StillWorld, shot: Shot, plan: GraspPlan, complete: dict[int, np.ndarray]) -> np.ndarray:
    """Return masks (4, h, w) bool: affordance left, right (complete object AND visible hand); complete object left, right."""
    hands = shot.hands(world, plan.options)
    empty = np.zeros_like(hands[0])
    objects = np.stack([complete[option.obj.number] if option else empty for option in plan.options])
    return np.concatenate([hands & objects, objects])


def _is_visible(plan: GraspPlan, masks: np.ndarray) -> bool:
    """Return True when every participating hand is visible enough on its object and not cut by the image border."""
    for option, mask in zip(plan.options, masks, strict=False):
        cut = mask[[0, -1]].any() or mask[:, [0, -1]].any()
        if option is not None and (cut or np.count_nonzero(mask) < MIN_AREA * mask.size):
            return False
    return True


def _iou(a: np.ndarray, b: np.ndarray) -> float:
    return float((a[:2] & b[:2]).sum() / max(int((a[:2] | b[:2]).sum()), 1))


def _mode(plan: GraspPlan, masks: np.ndarray, weight: float) -> Mode:
    left, right = ((plain_name(option.obj.model.noun), option.grip.name) if option else ("", "") for option in plan.options)
    return Mode(masks, (left[0], right[0]), (left[1], right[1]), plan.taxonomy, weight)


def _task_narration(video_id: str, number: int, task: Task) -> Narration:
    """Return the narration of a task, with its nouns in their order in the sentence."""
    nouns = sorted((obj.model.noun for obj in task.objects), key=lambda noun: task.text.find(plain_name(noun)))
    return narration(video_id, number, (number, number), task.text, task.verb, tuple(nouns))
