"""Rest poses of an object that is placed upright, or dropped in any orientation from a hand's breadth, as in AffordDex."""

from __future__ import annotations

from itertools import islice

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.hand.kinematics import moving_joints
from afford.grasping.sim.engine import CONTROL_S, State, World
from afford.grasping.sim.scene import Scene, hold_command

GAP_M = 0.05
"""initial gap between the table and the lowest point"""
LAID_M = 0.001
"""the same gap for an object that is placed"""
TRIES = 4
"""drops for each wanted pose, at most"""
SPEED_M_S, SPIN_RAD_S = 0.01, 0.1
STILL = 6
"""an object rests below these speeds for so many control steps; a rocking object is slow only where it turns back"""
MOST_S = 6.0
"""time to come to rest; round objects roll first"""
ROCKS, ROCKS_M, ROCKS_RAD = 20, 0.003, 0.05
"""an object also rests when it stays this near to one pose for so many control steps: thin hulls tremble in PyBullet"""


def laid_rest_pose(world: World, scene: Scene, turn: Rotation, most_s: float = MOST_S) -> np.ndarray | None:
    """Return the (7,) pose at rest of an object that is laid down in an orientation; None when it keeps rolling or rocking."""
    lowest = turn.apply(np.array(scene.body.corners, np.float64))[:, 2].min()
    return _settled(world, scene, np.array([0.0, 0.0, LAID_M - lowest, *turn.as_quat()]), most_s)


def placed_rest_pose(world: World, scene: Scene, most_s: float = MOST_S) -> np.ndarray:
    """Return the (7,) pose at rest of an object that is placed upright; ValueError when it keeps rolling or rocking."""
    found = _settled(world, scene, np.array([0.0, 0.0, LAID_M, 0.0, 0.0, 0.0, 1.0]), most_s)
    if found is None:
        raise ValueError(f"{scene.body.name}: expected the object to rest {most_s} s after it was placed, got "
                         f"{np.linalg.norm(world.state().velocity):.2f} m/s; drop it instead")  # fmt: skip
    return found


def dropped_rest_poses(world: World, scene: Scene, seed: int, count: int, most_s: float = MOST_S) -> list[np.ndarray]:
    """Return `count` poses (7,) at rest, for the first seeds from `seed` at which the object comes to rest at the origin.

    ValueError when most drops do not come to rest.
    """
    thrown = (_thrown(scene, np.random.default_rng(seed + k)) for k in range(TRIES * count))
    rests = (at for pose in thrown if (at := _settled(world, scene, pose, most_s)) is not None)
    poses = list(islice(rests, count))
    if len(poses) < count:
        raise ValueError(f"{scene.body.name}: expected {count} of {TRIES * count} drops to come to rest within {most_s} s, "
                         f"got {len(poses)}")
    return poses


def _settled(world: World, scene: Scene, pose: np.ndarray, most_s: float) -> np.ndarray | None:
    """Return the (7,) pose at rest, None when the object does not come to rest."""
    q = parked_joints(scene)
    stay = hold_command(scene, q)
    world.reset(q, pose)
    still, poses = 0, list[np.ndarray]()
    for _ in range(round(most_s / CONTROL_S)):
        state = world.step(stay, CONTROL_S)
        poses.append(state.body)
        still = still + 1 if _rests(state) else 0
        if still == STILL:
            return state.body
    return poses[-1] if _rocks(np.array(poses[-ROCKS:])) else None


def parked_joints(scene: Scene) -> np.ndarray:
    """Return the (d,) joints of an open hand away from the object."""
    q = np.zeros(len(moving_joints(scene.hand.joints)))
    q[:3] = 0.0, 1.0, 0.8
    return q


def _thrown(scene: Scene, rng: np.random.Generator) -> np.ndarray:
    turn = Rotation.random(rng=rng)
    centre = np.array([0.0, 0.0, GAP_M])
    corners = turn.apply(scene.body.corners - scene.body.com_m)
    return np.concatenate([centre - (0, 0, corners[:, 2].min()) - turn.apply(np.array(scene.body.com_m)), turn.as_quat()])


def _rocks(poses: np.ndarray) -> bool:
    """Return true when poses (k, 7) are all near the last one."""
    turned = (Rotation.from_quat(poses[:, 3:]) * Rotation.from_quat(poses[-1, 3:]).inv()).magnitude()
    moved = np.linalg.norm(poses[:, :3] - poses[-1, :3], axis=1)
    return bool(len(poses) == ROCKS and moved.max() < ROCKS_M and turned.max() < ROCKS_RAD)


def _rests(state: State) -> bool:
    return bool(np.linalg.norm(state.velocity) < SPEED_M_S and np.linalg.norm(state.spin) < SPIN_RAD_S)
