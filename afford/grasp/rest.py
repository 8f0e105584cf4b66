"""How objects lie on the table: as they are built, or as they come to rest when dropped at any orientation. The engine says so."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from afford.hands.coupling import driven
from afford.hands.kinematics import moving
from afford.sim.engine import State, World
from afford.sim.scene import Scene

SETTLE_S, LONGEST = 0.25, 16
"""an object is looked at every quarter of a second, for four seconds"""
STILL_M_S, STILL_RAD_S = 0.005, 0.1
GAP_M, DROP_M = 0.001, 0.02
TRIES = 8
ASIDE_M = (1.5, 1.5, 1.0)
"""where the hand waits"""


def flat(world: World, scene: Scene) -> np.ndarray:
    """(7,) the pose at rest of an object that is put down as it was built. RuntimeError when it does not come to rest."""
    pose = np.array([0.0, 0.0, GAP_M, 0.0, 0.0, 0.0, 1.0])
    found = _settled(world, scene, pose)
    if found is None:
        raise RuntimeError(f"{scene.body.name}: expected to lie still {SETTLE_S * LONGEST:g} s after being put down, got an object "
                           "that rolls or rocks; choose dropped poses")
    return found


def dropped(world: World, scene: Scene, rng: np.random.Generator) -> np.ndarray:
    """(7,) the pose at rest after a fall of 2 cm at a random orientation; the paper's. RuntimeError when none of eight rests."""
    for _ in range(TRIES):
        turn = Rotation.random(rng=rng)
        low = min(float(turn.apply(hull)[:, 2].min()) for hull in scene.body.hulls())
        found = _settled(world, scene, np.array([0.0, 0.0, DROP_M - low, *turn.as_quat()]))
        if found is not None:
            return found
    raise RuntimeError(f"{scene.body.name}: expected to lie still after one of {TRIES} drops, got an object that rolls on")


def _settled(world: World, scene: Scene, pose: np.ndarray) -> np.ndarray | None:
    joints = scene.hand.joints
    q = np.zeros(len(moving(joints)))
    q[:3] = ASIDE_M
    u = q[np.searchsorted(moving(joints), driven(joints))]
    world.reset(q, pose)
    for _ in range(LONGEST):
        state = world.step(u, SETTLE_S)
        if _still(state):
            return state.body
    return None


def _still(state: State) -> bool:
    return bool(np.linalg.norm(state.velocity) < STILL_M_S and np.linalg.norm(state.spin) < STILL_RAD_S)
