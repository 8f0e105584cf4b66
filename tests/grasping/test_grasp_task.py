"""Grasp tasks: the part to hold, negative points, poses of the object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.scenery import build_scenery
from afford.grasping.env.task import NEGATIVE_POINTS, make_task, placed_pose, spread_points
from afford.grasping.sim.engine import make_world
from afford.grasping.sim.rest_poses import dropped_rest_poses, placed_rest_pose
from afford.grasping.sim.scene import centre
from tests.helpers.made_hands import shadow
from tests.helpers.made_scenes import block, scene, tool


def test_negative_points_lie_on_negative_parts() -> None:
    """100 points; the part to hold is the largest of the others; given points replace them."""
    body = tool("spatula", 12)
    one = make_task(body, ("shaft", "head"))
    assert one.hold == body.parts.index("handle")
    assert one.N_t.shape == (NEGATIVE_POINTS, 3)
    own = body.points[np.isin(body.point_part, [body.parts.index("shaft"), body.parts.index("head")])]
    assert {tuple(p) for p in one.N_t.astype(np.float32)} <= {tuple(p) for p in own}
    given = np.random.default_rng(0).normal(size=(300, 3))
    assert {tuple(p) for p in make_task(body, ("head",), N_t=given).N_t} <= {tuple(p) for p in given}


def test_task_without_negative_parts() -> None:
    """No points then; few points are repeated."""
    assert make_task(block()).N_t.shape == (0, 3)
    few = np.eye(3)
    assert {tuple(p) for p in spread_points(few, 10)} == {tuple(p) for p in few}


def test_impossible_tasks_are_refused() -> None:
    """A part that the object lacks, no part left to hold, arrays that are no points."""
    with pytest.raises(ValueError, match="got wing"):
        make_task(block(), ("wing",))
    with pytest.raises(ValueError, match="may be held"):
        make_task(block(), ("foot", "top"))
    with pytest.raises(ValueError, match="may be held"):
        make_task(block(), ("top",), hold="top")
    with pytest.raises(ValueError, match="finite"):
        make_task(block(), N_t=np.full((3, 3), np.nan))


def test_placed_pose_keeps_height_and_turns_about_the_vertical() -> None:
    """The centre of mass is above the place at every yaw."""
    body = tool("spatula", 12)
    lying = np.array([0.3, 0.2, 0.01, *Rotation.from_euler("xyz", [0.2, -0.1, 0.5]).as_quat()])
    pose = placed_pose(body, lying, np.array([0.02, -0.03]), 1.1)
    assert centre(body, pose)[:2] == pytest.approx([0.02, -0.03])
    assert centre(body, pose)[2] == pytest.approx(centre(body, lying)[2])
    turn = Rotation.from_quat(pose[3:]) * Rotation.from_quat(lying[3:]).inv()
    assert turn.as_rotvec() == pytest.approx([0, 0, 1.1])


@pytest.mark.parametrize("engine", ["mujoco", "bullet"])
def test_rest_poses_are_stable(engine: str) -> None:
    """Flat, and dropped at three orientations: a second later the object has not moved, and touches the table."""
    where = scene(tool("spatula", 12))
    made = make_world(engine, where)
    q = np.zeros(28)
    q[:3] = 1.0
    u = np.zeros(24)
    u[:3] = 1.0
    poses = [placed_rest_pose(made, where), *dropped_rest_poses(made, where, 0, 3)]
    for pose in poses:
        made.reset(q, pose)
        after = made.step(u, 1.0).body
        assert np.linalg.norm(after[:3] - pose[:3]) < 0.004
        assert (Rotation.from_quat(after[3:]) * Rotation.from_quat(pose[3:]).inv()).magnitude() < 0.05
        low = min(float((Rotation.from_quat(pose[3:]).apply(np.array(hull)) + pose[:3])[:, 2].min()) for hull in where.body.hulls())
        assert abs(low) < 0.002
    made.close()


def test_allowed_points_are_farther_than_two_centimetres() -> None:
    """Distance from all negative points; all points without negative points, and where none is left."""
    body = tool("spatula", 12)
    some, none = make_task(body, ("head",)), make_task(body)
    made = build_scenery(shadow(), (some, none, replace(some, N_t=body.points.astype(np.float64))))
    apart = np.linalg.norm(made.surface[0][:, None] - some.N_t[None], axis=2).min(axis=1)
    assert (made.allowed[0] == (apart > 0.02)).all() and 0 < made.allowed[0].sum() < len(apart)
    assert made.allowed[1].all() and made.allowed[2].all()


def test_distance_to_positive_points() -> None:
    """The distance to the nearest point of A_t; 0 without A_t."""
    one = make_task(block())
    known = replace(one, A_t=np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.0]]))
    grasping = GraspWorlds(shadow(), (one, known), GraspEnvConfig(base="script"))
    grasping.reset([0, 1], [np.random.default_rng(0), np.random.default_rng(0)])
    tips, pose = grasping.state().tips[1], grasping.state().body[1]
    spots = Rotation.from_quat(pose[3:]).apply(known.A_t) + pose[:3]
    expected = np.linalg.norm(tips[:, None] - spots[None], axis=2).min(axis=1)
    np.testing.assert_allclose(grasping.measures().positive_m, [np.zeros(5), expected], atol=1e-12)
    grasping.close()
