"""Where a person could grasp a thing that lies on the table: anywhere along it, whatever the part there is."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.task import placed
from afford.grasping.sim.engine import make_world
from afford.grasping.sim.rest_poses import placed_rest_pose
from afford.grasping.sim.scene import Scene
from afford.grasping.sim.scripted import SLICE_M, aim_along_axis
from schemas.grasp import GraspObject
from schemas.hand import GraspTarget, HandModel

HANDLE_ALONG_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""a handle is along its z"""


def targets(hand: HandModel, body: GraspObject, engine: str, count: int, reach_m: float, thick_m: tuple[float, float],
            seed: int) -> Iterator[GraspTarget]:  # fmt: skip
    """`count` places along the object, even within `reach_m` of its centre of mass and kept off its ends; every second one with
    the object turned round. The world is the frame of an episode: the centre of mass above its origin, the object along x.
    """
    scene = Scene(hand, body)
    made = make_world(engine, scene)
    rest = placed_rest_pose(made, scene)
    made.close()
    yaw = aim_along_axis(scene, rest, 0.0).yaw
    rng = np.random.default_rng(seed)
    for k in range(count):
        pose = placed(body, rest, np.zeros(2), (k % 2) * np.pi - yaw)
        share = (2 * ((k + rng.random()) / count) - 1) * (1 - 2 * (k % 2))
        yield _target(scene, pose, reach_m * share, thick_m, f"{body.name}_{k:02d}")


def _target(scene: Scene, pose: np.ndarray, along_m: float, thick_m: tuple[float, float], name: str) -> GraspTarget:
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
