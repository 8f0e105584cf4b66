"""Grasp tasks of a household body with known parts: its uses, in poses upright, flat and dropped, with true negative points."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from zlib import crc32

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.body_tasks import BodySettings, held_tasks, laid_task, rigid_body, use_task
from afford.grasping.env.rest_choice import Turns, places_of, ranked_options, steady_turns
from afford.grasping.env.task import NEGATIVE_POINTS, spread_points
from afford.grasping.sim.engine import make_world
from afford.grasping.sim.rest_poses import dropped_rest_poses
from afford.grasping.sim.scene import Scene
from afford.surface.describe.household import household_look_up, uses_of
from schemas.bodies import BodyTasks
from schemas.grasp import GraspObject, GraspTask
from schemas.hand import HandModel
from schemas.mesh import MeshParts, ObjectMesh
from schemas.surface import PartDescription

UP, SIDE = 0.9, 0.5
"""cosine of the axis of a body and the vertical: at least UP as it was built, at most SIDE on its side"""


def household_tasks(hand: HandModel, mesh: ObjectMesh, parts: MeshParts, stands: bool, poses: Sequence[str], uses: int,
                    settings: BodySettings) -> BodyTasks:  # fmt: skip
    """Derive the tasks of a body that is built standing (`stands`) or lying: its first uses, each in each pose.

    A lying one is not set upright. ValueError for a category without rows in the lexicon, an unknown pose, or a mesh that
    cannot be a body.
    """
    wanted = uses_of(mesh.category)[:uses]
    if not wanted or set(poses) - set(POSES):
        raise ValueError(f"{mesh.name}: expected a category of the lexicon and poses among {', '.join(POSES)}, got "
                         f"{mesh.category!r} and {', '.join(poses)}")  # fmt: skip
    body = rigid_body(mesh, parts, settings)
    tasks, refused = list[GraspTask](), list[str]()
    for pose in (one for one in poses if stands or one != "upright"):
        turns = POSES[pose](hand, body, stands, settings.seed)
        for use in wanted:
            try:
                tasks.append(_posed(hand, body, household_look_up(mesh.name, mesh.category, use), pose, turns, settings))
            except ValueError as error:
                refused.append(str(error))
    return BodyTasks(mesh.name, tuple(tasks), tuple(places_of(one)[0].family for one in tasks), tuple(refused), ())


def _posed(hand: HandModel, body: GraspObject, one: PartDescription, pose: str, turns: Turns, s: BodySettings) -> GraspTask:
    """Create the task of a use in a pose, on the positive part with the best place."""
    usual = use_task(body, one)
    negative = np.isin(body.point_part, [body.parts.index(part) for part in usual.negative])
    N_t = spread_points(body.points[negative].astype(np.float64), NEGATIVE_POINTS)
    usual = replace(usual, name=f"{body.name}/{pose}/{usual.name.rpartition('/')[2]}", N_t=N_t)
    return laid_task(hand, usual, ranked_options(held_tasks(usual, one), turns), s, pose)


def _stable(body: GraspObject, low: float, high: float) -> Iterator[tuple[Rotation, float]]:
    """Yield the stable rotations in which the cosine of the body's z axis and the vertical is between two numbers."""
    for turn, steady in steady_turns(body):
        if low <= turn.as_matrix()[2, 2] <= high:
            yield turn, steady


def _upright(hand: HandModel, body: GraspObject, stands: bool, seed: int) -> Turns:
    """Rotations of a standing body as it was built."""
    return list(_stable(body, UP, 1.0))


def _flat(hand: HandModel, body: GraspObject, stands: bool, seed: int) -> Turns:
    """Rotations of a standing body on its side, and of a lying body as it was built."""
    return list(_stable(body, -SIDE, SIDE) if stands else _stable(body, UP, 1.0))


def _dropped(hand: HandModel, body: GraspObject, stands: bool, seed: int) -> Turns:
    """Rotation in which a body came to rest in MuJoCo after a drop at random."""
    scene = Scene(hand, body)
    world = make_world("mujoco", scene)
    try:
        (pose,) = dropped_rest_poses(world, scene, crc32(f"{body.name} {seed}".encode()), 1)
    except ValueError:  # keeps rolling: its uses are refused
        return []
    finally:
        world.close()
    return [(Rotation.from_quat(pose[3:]), 1.0)]


POSES: dict[str, Callable[[HandModel, GraspObject, bool, int], Turns]] = {"upright": _upright, "flat": _flat, "dropped": _dropped}
