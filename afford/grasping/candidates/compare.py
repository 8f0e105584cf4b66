"""Compare grasps from different kinds of masks: an object is rendered, grasped and lifted once for each kind.

The best candidate of each mask is executed by the scripted grasp. Candidates use the axes of the palm's grip; the script has its
own parameters. Straight from above both agree to the last digits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple
from zlib import crc32

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.candidates.find import SearchParams, find_candidates
from afford.grasping.env.measures import TOUCH_N
from afford.grasping.env.task import placed_pose
from afford.grasping.sim.engine import World, make_world
from afford.grasping.sim.rest_poses import placed_rest_pose
from afford.grasping.sim.scene import STRICT, Scene
from afford.grasping.sim.scripted import GRASP, Grasp, Outcome, joints_before, run_commands, settle, wrist_commands
from afford.render.camera import intrinsics, look_at
from afford.render.draw import render
from afford.render.materials import wood
from afford.render.mesh import has_area
from afford.render.raster import View, depth
from afford.render.scene import BACKGROUND, Camera, Instance, Light, Textures, batch
from afford.render.solids import patch
from afford.render.views.draw import drawable, material
from schemas.grasp import FIGURES, GraspComparison, GraspObject, GraspScene
from schemas.hand import HandModel
from schemas.mesh import MeshParts, ObjectMesh
from schemas.surface import PartDescription, PartDescriptions

TABLE_M = 0.6
"""half the side of the table"""
LIGHT = Light(centre=(0.0, 0.0, 0.05), radius_m=0.5)


@dataclass(frozen=True)
class ViewCamera:
    """Camera of a view."""

    distance_m: float = 0.6
    """from the middle of the object"""
    down_deg: float = 55.0
    """downward pitch"""
    field_deg: float = 42.0
    """horizontal field of view"""
    width_px: int = 320
    height_px: int = 240
    noise_m: float = 0.002
    """standard deviation of depth noise"""


class DepthView(NamedTuple):
    """rgb (h, w, 3) uint8; depth_m (h, w) float32 with noise; face (h, w) int32 of the object, else -1; K; T_world_cam."""

    rgb: np.ndarray
    depth_m: np.ndarray
    face: np.ndarray
    K: np.ndarray
    T_world_cam: np.ndarray


def render_view(mesh: ObjectMesh, body: np.ndarray, view: ViewCamera, rng: np.random.Generator,
                supersample: int = 2) -> DepthView:  # fmt: skip
    """Render the object at the pose (7,) on a table z = 0 with a random wood texture, from the front and above."""
    T_world_obj = np.eye(4)
    T_world_obj[:3, :3], T_world_obj[:3, 3] = Rotation.from_quat(body[3:]).as_matrix(), body[:3]
    corners = mesh.vertices @ T_world_obj[:3, :3].T + T_world_obj[:3, 3]
    camera = _camera((corners.min(0) + corners.max(0)) / 2, view)
    shown_object = Instance(drawable(mesh), material(mesh.texture), T_world_obj, entity=0)
    instances = (shown_object, _table(rng))
    textures = Textures.of(one.material for one in instances)
    shown = render(instances, camera, LIGHT, textures, supersample=supersample)
    face = _faces(mesh, instances, textures, camera)
    noise = rng.normal(0.0, view.noise_m, shown.depth_m.shape) if view.noise_m else 0.0
    noisy = np.where(shown.depth_m > 0, shown.depth_m + noise, 0.0).astype(np.float32)
    return DepthView(shown.rgb, noisy, face, camera.K, camera.T_world_cam)


def _camera(target: np.ndarray, view: ViewCamera) -> Camera:
    down = np.radians(view.down_deg)
    place = target + view.distance_m * np.array([0.0, -np.cos(down), np.sin(down)])
    return Camera(intrinsics(view.width_px, view.height_px, view.field_deg), look_at(place, target), view.width_px, view.height_px)


def _table(rng: np.random.Generator) -> Instance:
    side = 2 * TABLE_M
    top = patch(np.array([-TABLE_M, -TABLE_M, 0.0]), np.array([side, 0, 0]), np.array([0, side, 0]), (1.5, 1.5))
    return Instance(top, wood(rng), entity=BACKGROUND, casts=False)


def _faces(mesh: ObjectMesh, instances: tuple[Instance, ...], textures: Textures, camera: Camera) -> np.ndarray:
    """Return the (h, w) int32 face of the mesh at each pixel centre, else -1; the renderer skips faces without area."""
    kept = np.flatnonzero(has_area(mesh.vertices, mesh.faces)).astype(np.int32)
    view = View.of(batch(instances, textures), camera)
    seen, near = view.seen(1)[1]
    mine = (seen >= 0) & (seen < len(kept)) & (depth(near) > 0)
    return np.where(mine, kept[np.where(mine, seen, 0)], np.int32(-1))


RegionModel = Callable[[np.ndarray, str], np.ndarray]
"""two-hand model: image (h, w, 3) and task -> region (h, w) bool of the hand"""
RIGHT = np.array([False, True])


@dataclass(frozen=True, eq=False)
class Subject:
    """Object and the hand that grasps it."""

    hand: HandModel
    mesh: ObjectMesh
    parts: MeshParts
    body: GraspObject


@dataclass(frozen=True)
class Trials:
    """Parameters of a comparison."""

    engines: tuple[str, ...]
    looks: int
    xy_m: float
    camera: ViewCamera
    search: SearchParams
    seed: int


def compare_masks(subject: Subject, descriptions: PartDescriptions, model: RegionModel | None, trials: Trials) -> GraspComparison:
    """Run all trials on an object, for its tasks that differ in their parts.

    Without a model, its rows are left out. ValueError for an object that has no positive part, or that does not come to rest.
    """
    mine = _distinct_tasks(subject.parts, descriptions)
    if not mine:
        raise ValueError(f"{subject.mesh.name}: no task has a positive part among {', '.join(subject.parts.names)}; leave the "
                         "object out")  # fmt: skip
    scene = Scene(subject.hand, subject.body, STRICT)
    worlds = [make_world(engine, scene) for engine in trials.engines]
    try:
        rest = placed_rest_pose(worlds[0], scene)
        rows = [[_run_view(subject, scene, worlds, rest, one, model, trials, n) for n in range(trials.looks)] for one in mine]
    finally:
        for world in worlds:
            world.close()
    names = tuple(rows[0][0])
    values = np.array([[[look_[name] for look_ in task] for task in rows] for name in names])
    return GraspComparison(subject.mesh.name, subject.mesh.category, names, trials.engines, tuple(one.task for one in mine),
                           np.moveaxis(values, 3, 1))


def masks(parts: MeshParts, seen: DepthView, one: PartDescription,
          predicted: np.ndarray | None) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:  # fmt: skip
    """Yield (name of the method, region, negative), (h, w) bool each."""
    on = seen.face >= 0
    part = np.append(parts.part, np.int16(-1))[seen.face]
    good, bad = (np.append(_named(parts, one, role), False)[part] & on for role in ("positive", "negative"))
    for name, region in (("affordance", good), ("whole", on), ("predicted", predicted)):
        if region is not None:
            yield name, region, np.zeros_like(on)
            yield f"{name}+N", region, bad


def _run_view(subject: Subject, scene: Scene, worlds: list[World], rest: np.ndarray, one: PartDescription,
              model: RegionModel | None, trials: Trials, number: int) -> dict[str, np.ndarray]:  # fmt: skip
    """Run one view: method -> (e, k) figures."""
    rng = np.random.default_rng((trials.seed, crc32(f"{subject.mesh.name}/{one.task}".encode()), number))
    pose = placed_pose(subject.body, rest, rng.uniform(-trials.xy_m, trials.xy_m, 2), float(rng.uniform(-np.pi, np.pi)))
    seen = render_view(subject.mesh, pose, trials.camera, rng)
    predicted = model(seen.rgb, one.task) if model else None
    all_masks = list(masks(subject.parts, seen, one, predicted))
    return {name: _figures_of_mask(scene, worlds, pose, seen, region, bad, all_masks[0][1], one, trials.search)
            for name, region, bad in all_masks}  # fmt: skip


def _figures_of_mask(scene: Scene, worlds: list[World], pose: np.ndarray, seen: DepthView, region: np.ndarray, bad: np.ndarray,
                     truth: np.ndarray, one: PartDescription, search: SearchParams) -> np.ndarray:  # fmt: skip
    """Compute (e, k) figures of the best grasp of a mask; a mask without depth gives no grasp."""
    iou = (region & truth).sum() / max(int((region | truth).sum()), 1)
    nothing = np.tile([0.0] * (len(FIGURES) - 1) + [iou], (len(worlds), 1))
    if not (region & (seen.depth_m > 0)).any():
        return nothing
    regions = np.stack([np.zeros_like(region), region])
    scene_of_mask = GraspScene(scene.body.name, seen.depth_m, seen.rgb, seen.K, regions, RIGHT, bad, np.zeros((0, 3)))
    found = find_candidates(scene_of_mask, search).hands[1]
    if not len(found.score):
        return nothing
    negative = np.array([_role(one, name) == "negative" for name in scene.body.parts])
    T = seen.T_world_cam @ found.T_cam_grasp[0]
    return np.array([_figures(world, scene, pose, T, negative, float(found.score[0]), float(iou)) for world in worlds])


def _figures(world: World, scene: Scene, pose: np.ndarray, T: np.ndarray, negative: np.ndarray, score: float,
             iou: float) -> list[float]:  # fmt: skip
    out = execute_candidate(world, scene, pose, T)
    end, ever = out.force[negative].sum() > TOUCH_N, out.force_most[negative].sum() > TOUCH_N
    return [1.0, float(out.held), float(out.held and end), float(ever), float(out.held and not end), score, iou]


def _distinct_tasks(parts: MeshParts, descriptions: PartDescriptions) -> list[PartDescription]:
    """Return the first task of each combination of positive and negative parts, if it has a positive part."""
    kinds = {tuple(_role(one, name) for name in parts.names): one for one in reversed(descriptions.descriptions)}
    return [one for one in descriptions.descriptions if one in kinds.values() and _named(parts, one, "positive").any()]


def _named(parts: MeshParts, one: PartDescription, role: str) -> np.ndarray:
    """Return (p,) bool: parts of the mesh in a role."""
    return np.array([_role(one, name) == role for name in parts.names], bool)


def _role(one: PartDescription, part: str) -> str:
    return next((note.role for note in one.notes if note.part == part), "neutral")


FROM_ABOVE = Rotation.from_euler("x", np.pi / 2)
"""axes of a grasp straight from above: x along the object, y up"""


def wrist_at_grasp(scene: Scene, T_world_grasp: np.ndarray, grasp: Grasp = GRASP) -> np.ndarray:
    """Return the (6,) gantry joints of a grasp (4, 4) of a right hand: x, y, z, yaw, pitch, roll."""
    palm_of_script = Rotation.from_euler("ZYX", [grasp.yaw_rad, grasp.pitch_rad, grasp.roll_rad])
    to_grip = Rotation.from_matrix(np.array(scene.hand.R_palm_grip))
    turn = Rotation.from_matrix(T_world_grasp[:3, :3]) * FROM_ABOVE.inv() * palm_of_script * to_grip.inv()
    yaw_pitch_roll = turn.as_euler("ZYX")
    return np.concatenate([T_world_grasp[:3, 3] - turn.apply(to_grip.apply(grasp.grip_m)), yaw_pitch_roll])


def execute_candidate(world: World, scene: Scene, body: np.ndarray, T_world_grasp: np.ndarray, grasp: Grasp = GRASP) -> Outcome:
    """Grasp the object that rests at the pose (7,); the world stays as it is at the end.

    ValueError for a left hand.
    """
    if scene.hand.side != "right":
        raise ValueError(f"{scene.hand.name}: expected a right hand, got a {scene.hand.side} hand; mirror the grasp")
    back = T_world_grasp[:3, 1]
    at = wrist_at_grasp(scene, T_world_grasp, grasp)
    state = settle(world, scene, joints_before(scene, grasp, at, back), body)
    return run_commands(world, scene, state, wrist_commands(scene, grasp, at, back))
