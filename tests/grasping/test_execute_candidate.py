"""Execution of grasp candidates: from above they equal the scripted grasp; a tilted one moves along its approach."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from afford.grasping.candidates.compare import execute_candidate, wrist_at_grasp
from afford.grasping.hand.kinematics import command_limits, forward_kinematics
from afford.grasping.sim.engine import BACKENDS, make_world
from afford.grasping.sim.scene import STRICT, Scene
from afford.grasping.sim.scripted import ABOVE_M, GRASP, UP, Aim, grasp_commands, joints_before, wrist_commands
from tests.helpers.made_hands import shadow
from tests.helpers.made_scenes import at, tool


def from_above(yaw: float, place: tuple[float, float, float]) -> np.ndarray:
    """x along yaw, y up."""
    T = np.eye(4)
    T[:3, :3] = (Rotation.from_euler("z", yaw) * Rotation.from_euler("x", np.pi / 2)).as_matrix()
    T[:3, 3] = place
    return T


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(shadow(), tool("screwdriver", 12), STRICT)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.8, 3.1])
def test_a_candidate_from_above_equals_the_script(scene: Scene, yaw: float) -> None:
    """Commands agree to 1e-9, up to whole turns of the yaw."""
    place = (0.03, -0.02, 0.015)
    script = np.array(list(grasp_commands(scene, Aim(np.array(place), yaw), GRASP)))
    T = from_above(yaw, place)
    found = np.array(list(wrist_commands(scene, GRASP, wrist_at_grasp(scene, T), T[:3, 1])))
    off = found - script
    off[:, 3] = (off[:, 3] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(off).max() < 1e-9


def test_a_tilted_candidate_moves_along_its_approach(scene: Scene) -> None:
    """The grip starts 12 cm behind the candidate's place; all joints are within the gantry's limits."""
    T = from_above(0.5, (0.0, 0.0, 0.02))
    T[:3, :3] = Rotation.from_rotvec(0.4 * T[:3, 0]).as_matrix() @ T[:3, :3]
    low, high = command_limits(scene.hand.joints)[:6].T
    at_grasp = wrist_at_grasp(scene, T)
    assert (at_grasp >= low).all() and (at_grasp <= high).all()
    q = joints_before(scene, GRASP, at_grasp, T[:3, 1])
    palm = forward_kinematics(scene.hand.joints, q[None])[0, scene.hand.palm]
    grip = palm[:3, :3] @ GRASP.grip_m + palm[:3, 3]
    assert grip == pytest.approx(T[:3, 3] + ABOVE_M * T[:3, 1], abs=1e-9)
    assert abs(T[:3, 1] @ UP) < 0.95


@pytest.mark.parametrize("engine", sorted(BACKENDS))
def test_a_candidate_lifts_and_measures_forces_on_parts(engine: str, scene: Scene) -> None:
    """A grasp of the handle holds the tool and presses on the handle only; a grasp beside the tool holds nothing."""
    body = scene.body
    on_handle = body.points[body.point_part == body.parts.index("handle")]
    made = make_world(engine, scene)
    x, y, z = on_handle.mean(0).tolist()
    held = execute_candidate(made, scene, at(z=0.002), from_above(np.pi / 2, (x, y, z)))
    beside = execute_candidate(made, scene, at(z=0.002), from_above(np.pi / 2, (x + 0.3, y, z)))
    made.close()
    assert held.held and held.force[body.parts.index("handle")] > 0.1
    assert held.force[body.parts.index("tip")] == 0.0 and (held.force_most >= held.force).all()
    assert not beside.held and not beside.force_most.any()
