"""Grasp task: an object, the part to hold, its negative parts and points; poses of the object; places where people grasp it.

Negative parts and points exist twice: N_t and `told`, which a policy observes and is rewarded by, and the truth, which evaluates
it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from afford.common.geometry import farthest_point_sampling
from afford.grasping.sim.engine import make_world
from afford.grasping.sim.rest_poses import placed_rest_pose
from afford.grasping.sim.scene import Scene
from afford.grasping.sim.scripted import SLICE_M, aim_along_axis
from schemas.grasp import GraspObject, GraspTask
from schemas.hand import GraspTarget, HandModel

NEGATIVE_POINTS = 100
"""number of negative points, as in AffordDex"""


@dataclass(frozen=True, eq=False)
class Task:
    """Object and one use of it."""

    body: GraspObject
    hold: int
    """index of the part to hold"""
    negative: np.ndarray
    """(p,) bool, parts that are negative in truth, for evaluation"""
    N_true: np.ndarray
    """(100, 3) float64 m, object frame, points of these parts, for evaluation; (0, 3) without any"""
    N_t: np.ndarray
    """(100, 3) float64 m, object frame, negative points for observations and rewards; (0, 3) without any"""
    told: np.ndarray
    """(p,) bool, parts that are negative by N_t, for observations and rewards"""
    A_t: np.ndarray
    """(k, 3) float64 m, object frame, positive points for rewards; (0, 3) without any"""

    def __repr__(self) -> str:
        bad = [name for name, negative in zip(self.body.parts, self.negative, strict=True) if negative]
        return f"Task({self.body.name!r}, hold={self.body.parts[self.hold]!r}, negative={bad})"


def make_task(body: GraspObject, negative: Sequence[str] = (), hold: str = "", N_t: np.ndarray | None = None,
              told: Sequence[str] | None = None, A_t: np.ndarray | None = None) -> Task:  # fmt: skip
    """Create a task from names of parts and points (k, 3).

    `hold` defaults to the largest part that is not negative, N_t to points of the negative parts, `told` to the negative parts,
    A_t to no points. ValueError for parts that the object lacks, or when no part is left to hold.
    """
    unknown = sorted({*negative, *(told or ()), *filter(None, [hold])} - set(body.parts))
    if unknown:
        raise ValueError(f"{body.name}: expected parts among {', '.join(body.parts)}, got {', '.join(unknown)}")
    bad = np.array([name in negative for name in body.parts])
    size = np.bincount(body.point_part, minlength=len(bad)) * ~bad
    part = body.parts.index(hold) if hold else int(size.argmax())
    if not size[part]:
        raise ValueError(f"{body.name}: expected a part with points on it that may be held, got negative parts "
                         f"{', '.join(negative)}{f' and hold={hold!r}' if hold else ''}")
    true = spread_points(body.points[bad[body.point_part]].astype(np.float64), NEGATIVE_POINTS)
    shown = true if N_t is None else spread_points(np.asarray(N_t, np.float64), NEGATIVE_POINTS)
    said = bad if told is None else np.array([name in told for name in body.parts])
    return Task(body, part, bad, true, shown, said, np.zeros((0, 3)) if A_t is None else A_t)


def from_grasp_task(given: GraspTask) -> Task:
    """Convert the pipeline's GraspTask to a task. Its N_t is taken as it is, also where it differs from the truth."""
    return make_task(given.body, given.negative, given.hold, given.N_t, given.told, given.A_t)


def spread_points(points: np.ndarray, count: int) -> np.ndarray:
    """Sample (count, 3) of points (k, 3) by farthest point sampling, repeated when k < count; (0, 3) for k = 0."""
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ValueError(f"points: expected finite (k, 3), got shape {points.shape}")
    chosen = farthest_point_sampling(points, count)
    return points[np.resize(chosen, count)] if len(chosen) else np.zeros((0, 3))


def placed_pose(body: GraspObject, rest: np.ndarray, xy_m: np.ndarray, yaw_rad: float) -> np.ndarray:
    """(7,) pose at rest, turned about the vertical and moved so that the centre of mass is above xy, at the same height."""
    turn = Rotation.from_euler("z", yaw_rad)
    lying = turn * Rotation.from_quat(rest[3:])
    under = np.append(xy_m, rest[2]) - lying.apply(np.array(body.com_m)) * (1, 1, 0)
    return np.concatenate([under, lying.as_quat()])


HANDLE_ALONG_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""rotation of a handle, which is along its own z, along x of the world"""


def grasp_targets(hand: HandModel, body: GraspObject, engine: str, count: int, reach_m: float, thick_m: tuple[float, float],
                  seed: int) -> Iterator[GraspTarget]:  # fmt: skip
    """Yield `count` places along an object where a person could grasp it, whatever the part there.

    Places are even within `reach_m` of the centre of mass and kept off the ends; every second one has the object turned round. The
    world is the frame of an episode: the centre of mass above the origin, the object along x.
    """
    scene = Scene(hand, body)
    made = make_world(engine, scene)
    rest = placed_rest_pose(made, scene)
    made.close()
    yaw = aim_along_axis(scene, rest, 0.0).yaw
    rng = np.random.default_rng(seed)
    for k in range(count):
        pose = placed_pose(body, rest, np.zeros(2), (k % 2) * np.pi - yaw)
        share = (2 * ((k + rng.random()) / count) - 1) * (1 - 2 * (k % 2))
        yield target_at(scene, pose, reach_m * share, thick_m, f"{body.name}_{k:02d}")


def target_at(scene: Scene, pose: np.ndarray, along_m: float, thick_m: tuple[float, float], name: str) -> GraspTarget:
    """Build the target at a distance along an object at rest at a pose (7,) in the frame of an episode."""
    turn = Rotation.from_quat(pose[3:])
    spots = turn.apply(scene.body.points.astype(np.float64)) + pose[:3]
    x = aim_along_axis(scene, pose, along_m).place[0]
    slab = spots[np.abs(spots[:, 0] - x) <= SLICE_M]
    slab = slab if len(slab) else spots[np.abs(spots[:, 0] - x).argmin()][None]
    low, high = slab[:, 1:].min(0), slab[:, 1:].max(0)
    T_world_handle = np.eye(4)
    T_world_handle[:3, :3], T_world_handle[:3, 3] = HANDLE_ALONG_X, (x, *(low + high) / 2)
    T_world_object = np.eye(4)
    T_world_object[:3, :3], T_world_object[:3, 3] = turn.as_matrix(), pose[:3]
    return GraspTarget(name, scene.body.name, pose, np.linalg.inv(T_world_object) @ T_world_handle,
                       float(np.clip(high[0] - low[0], *thick_m)))  # fmt: skip
