"""Evaluate one object with two tasks: the same start, once with N_t at one end of the object and once at the other.

An end consists of the surface more than APART_M from the centre of mass along the object's long axis in the ground plane. N_t are
100 points of it, by farthest point sampling. The tasks name no part of the object, so only N_t distinguishes them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.rollout import EpisodeBatch, rollout
from afford.grasping.env.task import NEGATIVE_POINTS, from_grasp_task, spread_points
from afford.grasping.policies.load_policy import Policy
from afford.grasping.sim.scene import Physics
from schemas.episodes import GraspTrace, TwoTasks
from schemas.grasp import GraspObject, GraspTask
from schemas.hand import HandModel

APART_M = 0.02
ENDS = ("first", "other")


def long_axis(body: GraspObject) -> np.ndarray:
    """Return the (3,) long axis in the ground plane of the object as built, towards its first end."""
    spots = body.points[:, :2].astype(np.float64)
    found = np.linalg.svd(spots - spots.mean(0), full_matrices=False)[2][0]
    return np.append(found if found[0] > 0 or (found[0] == 0 and found[1] > 0) else -found, 0.0)


def opposite_end_tasks(body: GraspObject) -> tuple[GraspTask, GraspTask]:
    """Return the tasks with N_t at the first and at the other end; ValueError for an object without two such ends."""
    along = (body.points - body.com_m) @ long_axis(body)
    sides = [body.points[side * along > APART_M].astype(np.float64) for side in (1, -1)]
    if not all(map(len, sides)):
        raise ValueError(f"{body.name}: expected points farther than {APART_M:g} m from the centre of mass at both ends, got "
                         f"{len(sides[0])} and {len(sides[1])}; leave it out")
    first, other = (_end_task(body, end, side) for end, side in zip(ENDS, sides, strict=True))
    return first, other


def _end_task(body: GraspObject, end: str, points: np.ndarray) -> GraspTask:
    """Build a task that names no part; its N_t is chosen from points (k, 3)."""
    return GraspTask(f"{body.name}/{end}_end", "", "keep off this end", body, negative=(), hold="",
                     N_t=spread_points(points, NEGATIVE_POINTS), told=(), A_t=np.zeros((0, 3)))


def evaluate_task_pairs(hand: HandModel, bodies: Sequence[GraspObject], policy: Policy, name: str, engine: str, physics: Physics,
                rounds: int, at_once: int, shown: int, seed: int,
                progress: Callable[[int, int], None]) -> tuple[TwoTasks, list[tuple[GraspTask, GraspTrace]]]:  # fmt: skip
    """Play both tasks of every body, `rounds` times.

    Also returns traces of both tasks for `shown` bodies: those whose hand moved farthest from the negative end in the first round,
    among the bodies that were lifted twice. ValueError without bodies, or for a body that `opposite_end_tasks` rejects.
    """
    if not bodies:
        raise ValueError("two tasks: no objects to grasp")
    config = policy.config(engine, physics, "flat", 0.0)
    along, success, names = list[np.ndarray](), list[np.ndarray](), list[str]()
    traced = list[tuple[float, list[tuple[GraspTask, GraspTrace]]]]()
    for first in range(0, len(bodies), at_once):
        some = bodies[first : first + at_once]
        tasks = [one for body in some for one in opposite_end_tasks(body)]
        grasping = GraspWorlds(hand, [from_grasp_task(one) for one in tasks], config)
        for number in range(rounds):
            rngs = [np.random.default_rng([seed, first + k // 2, number]) for k in range(len(tasks))]
            played = rollout(grasping, policy.actor(grasping), rngs)
            along.append(_along(played, some, grasping.scenery.palm_offset))
            success.append(played.report["success"].reshape(-1, 2) > 0)
            names += [body.name for body in some]
            traced += _traces(played, tasks, along[-1], success[-1]) if number == 0 else []
            progress(first * rounds + (number + 1) * len(some), len(bodies) * rounds)
        grasping.close()
    best = sorted(traced, key=lambda one: -one[0])[:shown]
    made = TwoTasks(name=f"{name}-{engine}-{policy.seed}", policy=name, engine=engine, seed=policy.seed, body=tuple(names),
                    along_m=np.concatenate(along), success=np.concatenate(success))  # fmt: skip
    return made, [one for _, both in best for one in both]


def _along(played: EpisodeBatch, bodies: Sequence[GraspObject], palm_offset: np.ndarray) -> np.ndarray:
    """Return (b, 2) positions of the grasp along the long axis, m."""
    rows = np.arange(len(played.ended))
    palm, lies = played.palm[rows, played.ended], played.body[rows, played.ended]
    middle = Rotation.from_quat(palm[:, 3:]).apply(palm_offset) + palm[:, :3]
    local = Rotation.from_quat(lies[:, 3:]).inv().apply(middle - lies[:, :3])
    each = [(spot - bodies[k // 2].com_m) @ long_axis(bodies[k // 2]) for k, spot in enumerate(local)]
    return np.array(each).reshape(-1, 2)


def _traces(played: EpisodeBatch, tasks: Sequence[GraspTask], along: np.ndarray,
            success: np.ndarray) -> list[tuple[float, list[tuple[GraspTask, GraspTrace]]]]:  # fmt: skip
    """Return for every body the shift of the hand (m), -inf where it was not lifted twice, and its two traces."""
    moved = np.where(success.all(axis=1), along[:, 1] - along[:, 0], -np.inf)
    both = [[(tasks[k], played.trace(k, tasks[k].name, 0)) for k in (2 * row, 2 * row + 1)] for row in range(len(moved))]
    return list(zip(moved.tolist(), both, strict=True))
