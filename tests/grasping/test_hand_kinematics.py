"""Forward kinematics agrees with MuJoCo and PyBullet; the Jacobian is the derivative."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pybullet
import pytest
from scipy.spatial.transform import Rotation

from afford.grasping.hand.assets import shadow_files
from afford.grasping.hand.export import save_hand
from afford.grasping.hand.kinematics import (
    commanded_joints,
    coupling_matrix,
    forward_kinematics,
    jacobian,
    joint_limits,
    moving_joints,
    points_on_links,
)
from schemas.hand import HandModel
from tests.helpers.made_hands import COUPLED, PINCER, SHARED, hand_of, poses, shadow, tree, written


@pytest.fixture(scope="module")
def original() -> mujoco.MjModel:
    """Load the hand as its package does."""
    robot = next(file.path for file in shadow_files().files if file.name == "hand/robot.xml")
    return mujoco.MjModel.from_xml_path(str(robot.with_name("reach.xml")))


def at(model: mujoco.MjModel, data: mujoco.MjData, hand: HandModel, q: np.ndarray) -> None:
    """Set MuJoCo's finger joints to q."""
    for k, value in zip(moving_joints(hand.joints), q, strict=True):
        if hand.joints.role[k] in ("actuated", "coupled"):
            data.joint(f"robot0:{hand.joints.name[k]}").qpos = value
    mujoco.mj_kinematics(model, data)


def pose(body: object) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = body.xmat.reshape(3, 3), body.xpos  # type: ignore[attr-defined]  # a view of MuJoCo
    return T


def test_mujoco_agrees(original: mujoco.MjModel) -> None:
    """100 random configurations: every link and every fingertip agrees to a micrometre, relative to the palm."""
    hand = shadow()
    data, q = mujoco.MjData(original), poses(hand, 100, seed=1)
    T = forward_kinematics(hand.joints, q)
    T = np.linalg.inv(T[:, hand.palm])[:, None] @ T
    tips = points_on_links(T, hand.fingers.tip_link, hand.fingers.tip_m)
    for row in range(100):
        at(original, data, hand, q[row])
        base = np.linalg.inv(pose(data.body("robot0:palm")))
        for number, link in enumerate(hand.links[hand.palm:], hand.palm):
            np.testing.assert_allclose(T[row, number], base @ pose(data.body(f"robot0:{link}")), atol=1e-6, err_msg=link)
        for tip, short in zip(tips[row], ("th", "ff", "mf", "rf", "lf"), strict=True):
            there = base[:3, :3] @ data.site(f"robot0:S_{short}tip").xpos + base[:3, 3]
            np.testing.assert_allclose(tip, there, atol=1e-6)


def check_against_pybullet(hand: HandModel, folder: Path, count: int) -> None:
    """Compare every link to 10 micrometres and 1e-5 per entry of its rotation, and all limits."""
    client, q = pybullet.connect(pybullet.DIRECT), poses(hand, count, seed=2)
    try:
        body = pybullet.loadURDF(str(save_hand(hand, folder)), useFixedBase=True, physicsClientId=client)
        info = [pybullet.getJointInfo(body, k, client) for k in range(pybullet.getNumJoints(body, client))]
        order = {entry[1].decode(): entry for entry in info}
        assert set(order) == set(hand.joints.name)
        for k, (low, high) in zip(moving_joints(hand.joints), joint_limits(hand.joints), strict=True):
            assert order[hand.joints.name[k]][8:12] == (low, high, hand.joints.effort[k], hand.joints.velocity[k])
        for row, T in zip(q, forward_kinematics(hand.joints, q), strict=True):
            for k, value in zip(moving_joints(hand.joints), row, strict=True):
                pybullet.resetJointState(body, order[hand.joints.name[k]][0], value, physicsClientId=client)
            for k, name in enumerate(hand.joints.name):
                state = pybullet.getLinkState(body, order[name][0], computeForwardKinematics=1, physicsClientId=client)
                found, turn = T[hand.joints.child[k]], Rotation.from_quat(state[5]).as_matrix()
                np.testing.assert_allclose(found[:3, 3], state[4], atol=1e-5, err_msg=name)
                np.testing.assert_allclose(found[:3, :3], turn, atol=1e-5, err_msg=name)
    finally:
        pybullet.disconnect(client)


def test_pybullet_agrees(tmp_path: Path) -> None:
    """The Shadow Hand on its gantry is loaded from our URDF."""
    check_against_pybullet(shadow(), tmp_path, 20)


def test_pybullet_agrees_on_capsules_in_parts(tmp_path: Path) -> None:
    """Capsules in parts are standard URDF."""
    check_against_pybullet(shadow(capsules="parts"), tmp_path, 2)


def test_pybullet_agrees_on_a_hand_with_turned_joints(tmp_path: Path) -> None:
    """Axes and origins of this hand are oblique."""
    check_against_pybullet(hand_of(written(tmp_path, PINCER)), tmp_path / "saved", 20)


@pytest.mark.skipif(not SHARED.is_dir(), reason="needs ../shared/data/hands")
@pytest.mark.parametrize("side", ["left", "right"])
def test_pybullet_agrees_on_the_makers_urdf(side: str, tmp_path: Path) -> None:
    """The URDFs of the maker have meshes."""
    hand = hand_of(tree(SHARED, f"shadow_hand_{side}.urdf"), coupled=COUPLED)
    check_against_pybullet(hand, tmp_path, 5)
    roles = [hand.joints.role.count(role) for role in ("wrist", "actuated", "coupled")]
    assert (hand.side, roles) == (side, [6, 18, 4])


def test_the_jacobian_is_the_derivative() -> None:
    """Central differences for tips and keypoints and all joints; a joint moves only points that it carries."""
    hand = shadow()
    q, step = poses(hand, 3, seed=3), 1e-6
    links = np.concatenate([hand.fingers.tip_link, hand.fingers.middle_link])
    offsets = np.concatenate([hand.fingers.tip_m, np.full((5, 3), 0.01)])
    found = jacobian(hand.joints, forward_kinematics(hand.joints, q), links, offsets)
    for column in range(q.shape[1]):
        ahead, behind = q.copy(), q.copy()
        ahead[:, column] += step
        behind[:, column] -= step
        there, back = (points_on_links(forward_kinematics(hand.joints, moved), links, offsets) for moved in (ahead, behind))
        change = (there - back) / (2 * step)
        np.testing.assert_allclose(found[..., column], change, atol=1e-8)
    assert np.abs(found).max() > 0.05


def test_coupling_matrix() -> None:
    """24 commands become 28 positions; the last joint of a finger equals the one before it."""
    hand = shadow()
    A, b = coupling_matrix(hand.joints)
    u = np.random.default_rng(4).uniform(-1, 1, (7, 24))
    q = u @ A.T + b
    names = [hand.joints.name[k] for k in moving_joints(hand.joints)]
    assert A.shape == (28, 24)
    for finger in ("FF", "MF", "RF", "LF"):
        assert (q[:, names.index(f"{finger}J0")] == q[:, names.index(f"{finger}J1")]).all()
    commanded = [names.index(hand.joints.name[k]) for k in commanded_joints(hand.joints)]
    assert (q[:, commanded] == u).all()


def test_q_of_a_wrong_length_is_rejected() -> None:
    """The error states the number of columns."""
    with pytest.raises(ValueError, match=r"expected \(n, 28\)"):
        forward_kinematics(shadow().joints, np.zeros((1, 24)))
