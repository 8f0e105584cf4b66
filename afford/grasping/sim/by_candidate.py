"""A grasp candidate done by the script: the hand comes along its approach, closes, lifts.

Candidates have the axes of the palm's grip, the script has numbers of its own; straight from above both are the same to the last
digits.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.sim.engine import World
from afford.grasping.sim.scene import Scene
from afford.grasping.sim.scripted import GRASP, Grasp, Outcome, before, carried, moves, settled

FROM_ABOVE = Rotation.from_euler("x", np.pi / 2)
"""axes of a grasp straight from above: x along the thing, y up"""


def wrist(scene: Scene, T_world_grasp: np.ndarray, grasp: Grasp = GRASP) -> np.ndarray:
    """(6,) of the gantry for a grasp (4, 4) of a right hand: x, y, z, yaw, pitch, roll."""
    palm_of_script = Rotation.from_euler("ZYX", [grasp.yaw_rad, grasp.pitch_rad, grasp.roll_rad])
    to_grip = Rotation.from_matrix(np.array(scene.hand.R_palm_grip))
    turn = Rotation.from_matrix(T_world_grasp[:3, :3]) * FROM_ABOVE.inv() * palm_of_script * to_grip.inv()
    yaw_pitch_roll = turn.as_euler("ZYX")
    return np.concatenate([T_world_grasp[:3, 3] - turn.apply(to_grip.apply(grasp.grip_m)), yaw_pitch_roll])


def execute(world: World, scene: Scene, body: np.ndarray, T_world_grasp: np.ndarray, grasp: Grasp = GRASP) -> Outcome:
    """Grasp the object that rests at the pose (7,). ValueError for a hand that is no right hand; leaves the world at the end."""
    if scene.hand.side != "right":
        raise ValueError(f"{scene.hand.name}: expected a right hand, got a {scene.hand.side} one; mirror the grasp")
    back = T_world_grasp[:3, 1]
    at = wrist(scene, T_world_grasp, grasp)
    state = settled(world, scene, before(scene, grasp, at, back), body)
    return carried(world, scene, state, moves(scene, grasp, at, back))
