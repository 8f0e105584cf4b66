"""Choice of the pose in which a body is laid on the table: stable on a face of its hull, with the part to hold within reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from afford.grasping.env.families import GraspPlace, grasp_places
from schemas.grasp import GraspObject, GraspTask

Turns = list[tuple[Rotation, float]]
"""rotations in which a body rests, each with a steadiness of 0..1"""
SAME = 0.02
"""faces whose unit normals differ by less are one"""
TOUCH_M = 0.002
"""corners within this of the table carry the body"""
TIPS_RAD = 0.06
"""a body that tips over at less is not stable"""
STEADY_RAD = 0.25
"""from here on a larger angle is no better"""


def places_of(task: GraspTask) -> list[GraspPlace]:
    """Find the places of a task, best first."""
    body = task.body
    part = np.ones(len(body.points), bool) if not task.hold else body.point_part == body.parts.index(task.hold)
    return grasp_places(body.points, body.normals, part, task.N_t, body.com_m, task.use)


def stable_turns(body: GraspObject) -> list[tuple[Rotation, float]]:
    """Find the rotations that lay a body on a face of its hull, with the angle (rad) at which it tips over; steadiest first."""
    hull = ConvexHull(body.corners)
    downs: list[np.ndarray] = [np.array([0.0, 0.0, -1.0])]
    for normal in hull.equations[np.argsort(-_areas(hull), kind="stable"), :3]:
        if all(np.linalg.norm(normal - known) > SAME for known in downs):
            downs.append(normal)
    turns = [Rotation.align_vectors([[0, 0, -1]], [down])[0] for down in downs]
    found = [(turn, _tips_rad(body, turn)) for turn in turns]
    return sorted((one for one in found if one[1] > TIPS_RAD), key=lambda one: -one[1])


def laid(task: GraspTask, turn: Rotation) -> GraspTask:
    """Turn the object of a task, with its points, and put it on z = 0."""
    down = np.array([0.0, 0.0, float(turn.apply(task.body.corners)[:, 2].min())])

    def moved(points: np.ndarray) -> np.ndarray:
        return np.asarray((turn.apply(points) - down if len(points) else points).astype(points.dtype))

    body, R = task.body, turn.as_matrix()
    turned = replace(body, corners=moved(body.corners), com_m=moved(body.com_m[None])[0], points=moved(body.points),
                     normals=turn.apply(body.normals).astype(np.float32), inertia_kgm2=R @ body.inertia_kgm2 @ R.T,
                     size_m=np.ptp(turn.apply(body.points), axis=0))  # fmt: skip
    return replace(task, body=turned, N_t=moved(task.N_t), A_t=moved(task.A_t))


def steady_turns(body: GraspObject) -> Turns:
    """Find the stable rotations of a body, steadiest first."""
    return [(turn, min(1.0, tips / STEADY_RAD)) for turn, tips in stable_turns(body)]


def ranked_options(tasks: Sequence[GraspTask], turns: Turns) -> list[tuple[GraspTask, Rotation]]:
    """Rank tasks, which differ in the part to hold, and rotations, by the fit of their best place times the steadiness."""
    scored = [(places[0].fit * steady, task, turn) for turn, steady in turns for task in tasks
              if (places := places_of(laid(task, turn)))]  # fmt: skip
    return [(task, turn) for _, task, turn in sorted(scored, key=lambda one: -one[0])]


def _tips_rad(body: GraspObject, turn: Rotation) -> float:
    """Return the least angle by which a body on the table tips over; 0 where its centre of mass is beside its base."""
    corners, com = turn.apply(body.corners), turn.apply(body.com_m)
    low = corners[:, 2].min()
    try:
        base = ConvexHull(corners[corners[:, 2] < low + TOUCH_M][:, :2])
    except (QhullError, ValueError):  # carried by fewer than three points
        return 0.0
    inside = -(base.equations[:, :2] @ com[:2] + base.equations[:, 2]).max()
    return float(np.arctan2(max(inside, 0.0), com[2] - low))


def _areas(hull: ConvexHull) -> np.ndarray:
    corner = hull.points[hull.simplices]
    found: np.ndarray = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    return found
