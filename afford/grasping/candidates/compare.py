"""Grasps from masks of one kind against those of another: an object is looked at, grasped and lifted, once for each kind."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from zlib import crc32

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.candidates.find import SearchParams, find_candidates
from afford.grasping.candidates.render_view import DepthView, ViewCamera, render_view
from afford.grasping.env.measures import TOUCH_N
from afford.grasping.env.task import placed_pose
from afford.grasping.sim.engine import World, make_world
from afford.grasping.sim.rest_poses import placed_rest_pose
from afford.grasping.sim.scene import STRICT, Scene
from afford.grasping.sim.scripted import GRASP, Grasp, Outcome, joints_before, run_commands, settle, wrist_commands
from schemas.grasp import FIGURES, GraspComparison, GraspObject, GraspScene
from schemas.hand import HandModel
from schemas.mesh import MeshParts, ObjectMesh
from schemas.surface import PartDescription, PartDescriptions

Ask = Callable[[np.ndarray, str], np.ndarray]
"""a picture (h, w, 3) and a task -> the region (h, w) bool where a hand belongs"""
RIGHT = np.array([False, True])


@dataclass(frozen=True, eq=False)
class Subject:
    """One object and the hand that grasps it."""

    hand: HandModel
    mesh: ObjectMesh
    parts: MeshParts
    body: GraspObject


@dataclass(frozen=True)
class Trials:
    """What is tried."""

    engines: tuple[str, ...]
    looks: int
    xy_m: float
    eye: ViewCamera
    wish: SearchParams
    seed: int


def compare_masks(subject: Subject, told: PartDescriptions, ask: Ask | None, trials: Trials) -> GraspComparison:
    """All trials on an object, of its tasks that differ in their parts; without a model to ask, its rows are left out. ValueError
    for an object that has no part where a hand belongs, or that does not lie still.
    """
    mine = _different(subject.parts, told)
    if not mine:
        raise ValueError(f"{subject.mesh.name}: expected a task with positive parts among {', '.join(subject.parts.names)}, got "
                         "none; leave the object out")  # fmt: skip
    scene = Scene(subject.hand, subject.body, STRICT)
    worlds = [make_world(engine, scene) for engine in trials.engines]
    try:
        rest = placed_rest_pose(worlds[0], scene)
        rows = [[_tried(subject, scene, worlds, rest, one, ask, trials, n) for n in range(trials.looks)] for one in mine]
    finally:
        for made in worlds:
            made.close()
    names = tuple(rows[0][0])
    values = np.array([[[look_[name] for look_ in task] for task in rows] for name in names])
    return GraspComparison(subject.mesh.name, subject.mesh.category, names, trials.engines, tuple(one.task for one in mine),
                           np.moveaxis(values, 3, 1))


def masks(parts: MeshParts, seen: DepthView, one: PartDescription,
          said: np.ndarray | None) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:  # fmt: skip
    """(name of the method, region, negative), (h, w) bool each."""
    on = seen.face >= 0
    part = np.append(parts.part, np.int16(-1))[seen.face]
    good, bad = (np.append(_named(parts, one, role), False)[part] & on for role in ("positive", "negative"))
    for name, region in (("affordance", good), ("whole", on), ("predicted", said)):
        if region is not None:
            yield name, region, np.zeros_like(on)
            yield f"{name}+N", region, bad


def _tried(subject: Subject, scene: Scene, worlds: list[World], rest: np.ndarray, one: PartDescription, ask: Ask | None,
           trials: Trials, number: int) -> dict[str, np.ndarray]:  # fmt: skip
    """Method -> (e, k) figures, of one look."""
    rng = np.random.default_rng((trials.seed, crc32(f"{subject.mesh.name}/{one.task}".encode()), number))
    pose = placed_pose(subject.body, rest, rng.uniform(-trials.xy_m, trials.xy_m, 2), float(rng.uniform(-np.pi, np.pi)))
    seen = render_view(subject.mesh, pose, trials.eye, rng)
    said = ask(seen.rgb, one.task) if ask else None
    all_masks = list(masks(subject.parts, seen, one, said))
    return {name: _figures_of_mask(scene, worlds, pose, seen, region, bad, all_masks[0][1], one, trials.wish)
            for name, region, bad in all_masks}  # fmt: skip


def _figures_of_mask(scene: Scene, worlds: list[World], pose: np.ndarray, seen: DepthView, region: np.ndarray, bad: np.ndarray,
                     truth: np.ndarray, one: PartDescription, search: SearchParams) -> np.ndarray:  # fmt: skip
    """(e, k) figures of grasps from one mask; a mask of which nothing has depth gives no grasp."""
    iou = (region & truth).sum() / max(int((region | truth).sum()), 1)
    nothing = np.tile([0.0] * (len(FIGURES) - 1) + [iou], (len(worlds), 1))
    if not (region & (seen.depth_m > 0)).any():
        return nothing
    sight = GraspScene(scene.body.name, seen.depth_m, seen.rgb, seen.K, np.stack([np.zeros_like(region), region]), RIGHT, bad,
                       np.zeros((0, 3)))  # fmt: skip
    found = find_candidates(sight, search).hands[1]
    if not len(found.score):
        return nothing
    negative = np.array([_role(one, name) == "negative" for name in scene.body.parts])
    T = seen.T_world_cam @ found.T_cam_grasp[0]
    return np.array([_figures(made, scene, pose, T, negative, float(found.score[0]), float(iou)) for made in worlds])


def _figures(made: World, scene: Scene, pose: np.ndarray, T: np.ndarray, negative: np.ndarray, score: float,
             iou: float) -> list[float]:  # fmt: skip
    out = execute_candidate(made, scene, pose, T)
    end, ever = out.force[negative].sum() > TOUCH_N, out.force_most[negative].sum() > TOUCH_N
    return [1.0, float(out.held), float(out.held and end), float(ever), float(out.held and not end), score, iou]


def _different(parts: MeshParts, told: PartDescriptions) -> list[PartDescription]:
    """The first task of each that take and forbid the same parts, and take any."""
    kinds = {tuple(_role(one, name) for name in parts.names): one for one in reversed(told.descriptions)}
    return [one for one in told.descriptions if one in kinds.values() and _named(parts, one, "positive").any()]


def _named(parts: MeshParts, one: PartDescription, role: str) -> np.ndarray:
    """(p,) bool: parts of the mesh in a role."""
    return np.array([_role(one, name) == role for name in parts.names], bool)


def _role(one: PartDescription, part: str) -> str:
    return next((note.role for note in one.notes if note.part == part), "neutral")


FROM_ABOVE = Rotation.from_euler("x", np.pi / 2)
"""axes of a grasp straight from above: x along the thing, y up"""


def wrist_at_grasp(scene: Scene, T_world_grasp: np.ndarray, grasp: Grasp = GRASP) -> np.ndarray:
    """(6,) of the gantry for a grasp (4, 4) of a right hand: x, y, z, yaw, pitch, roll."""
    palm_of_script = Rotation.from_euler("ZYX", [grasp.yaw_rad, grasp.pitch_rad, grasp.roll_rad])
    to_grip = Rotation.from_matrix(np.array(scene.hand.R_palm_grip))
    turn = Rotation.from_matrix(T_world_grasp[:3, :3]) * FROM_ABOVE.inv() * palm_of_script * to_grip.inv()
    yaw_pitch_roll = turn.as_euler("ZYX")
    return np.concatenate([T_world_grasp[:3, 3] - turn.apply(to_grip.apply(grasp.grip_m)), yaw_pitch_roll])


def execute_candidate(world: World, scene: Scene, body: np.ndarray, T_world_grasp: np.ndarray, grasp: Grasp = GRASP) -> Outcome:
    """Grasp the object that rests at the pose (7,). ValueError for a hand that is no right hand; leaves the world at the end."""
    if scene.hand.side != "right":
        raise ValueError(f"{scene.hand.name}: expected a right hand, got a {scene.hand.side} one; mirror the grasp")
    back = T_world_grasp[:3, 1]
    at = wrist_at_grasp(scene, T_world_grasp, grasp)
    state = settle(world, scene, joints_before(scene, grasp, at, back), body)
    return run_commands(world, scene, state, wrist_commands(scene, grasp, at, back))
