"""The published blocks: 300 numbers in their order, turned into the yaw of the palm ("repose_z") about the episode's origin; and
clouds for PointNets, from the palm.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.moment import Block, Now
from afford.grasping.env.observe_small import fingers_q
from afford.grasping.env.scenery import OBJECT_POINTS, about_z, to_frame
from afford.grasping.env.task import NEGATIVE_POINTS
from afford.grasping.hand.kinematics import ancestry, commanded_columns, forward_kinematics, jacobian, moving_joints


def _all_torques(now: Now) -> np.ndarray:
    """Of the motors; joints that are coupled have none and show 0."""
    joints = now.scenery.hand.joints
    out = np.zeros_like(now.state.q)
    out[:, commanded_columns(joints)] = now.state.torque
    return 10.0 * out[:, 6:]


def _tips(now: Now) -> np.ndarray:
    """(n, f, 13) pose, velocity and angular velocity, by the hand's kinematics."""
    hand, q, qd = now.scenery.hand, now.state.q, now.state.qd
    T, links, yaw = forward_kinematics(hand.joints, q), hand.fingers.tip_link, now.palm_yaw
    turn = about_z(-yaw)
    quaternion = np.stack([(turn * Rotation.from_matrix(T[:, link, :3, :3])).as_quat() for link in links], axis=1)
    velocity = np.einsum("nfid,nd->nfi", jacobian(hand.joints, T, links, hand.fingers.tip_m), qd)
    move = moving_joints(hand.joints)
    carried = hand.joints.child[move]
    axis = np.einsum("ndij,dj->ndi", T[:, carried, :3, :3], hand.joints.axis[move])
    turns = np.array([hand.joints.kind[k] == "revolute" for k in move])
    carries = ancestry(hand.joints)[np.ix_(links, carried)] * turns
    spin = np.einsum("fd,ndi,nd->nfi", carries.astype(float), axis, qd)
    return np.concatenate([now.spot(now.state.tips, yaw), quaternion, to_frame(velocity, yaw), to_frame(spin, yaw)], axis=2)


def _tip_forces(now: Now) -> np.ndarray:
    """(n, f, 6): the engines give how hard a finger presses, not where to; that is the first of the six, the others are 0."""
    out = np.zeros((*now.state.tips.shape[:2], 6))
    out[:, :, 0] = 10.0 * now.state.force[:, :-1].sum(axis=2)
    return out


def _palm_euler(now: Now) -> np.ndarray:
    yaw = now.palm_yaw
    turned = about_z(-yaw) * Rotation.from_quat(now.state.palm[:, 3:])
    return np.concatenate([now.spot(now.state.palm[:, :3], yaw), turned.as_euler("xyz")], axis=1)


def _paper_object(now: Now) -> np.ndarray:
    yaw, state = now.palm_yaw, now.state
    turned = (about_z(-yaw) * Rotation.from_quat(state.body[:, 3:])).as_quat()
    away = now.episode.goal - now.scenery.centre(state)
    parts = (now.spot(state.body[:, :3], yaw), turned, to_frame(state.velocity, yaw), 0.2 * to_frame(state.spin, yaw),
             to_frame(away, yaw))  # fmt: skip
    return np.concatenate(parts, axis=1)


def _cloud(now: Now, points: np.ndarray) -> np.ndarray:
    return to_frame(points - now.scenery.palm(now.state)[:, None], now.palm_yaw)


ROBOT = (
    Block("q", 22, "joints of the fingers, rad", fingers_q),
    Block("qd", 22, "their speed x 0.2", lambda now: 0.2 * now.state.qd[:, 6:]),
    Block("torque", 22, "of their motors x 10; 0 for the four joints that have none", _all_torques),
    Block("tips", 65, "each fingertip: place, quaternion, velocity, angular velocity", _tips),
    Block("tip_force", 30, "each finger: how hard it presses x 10; five numbers that the engines do not give are 0", _tip_forces),
    Block("palm", 6, "place and Euler angles (xyz)", _palm_euler),
    Block("action", 24, "the last", lambda now: now.action),
)
OBJECT = Block("object", 16, "pose, velocity, spin x 0.2, from its centre of mass to the goal", _paper_object)
CLOUD_N = Block("N_t", 3 * NEGATIVE_POINTS, "negative points, from the palm; all at the object's origin where there are none",
                lambda now: _cloud(now, now.scenery.negative_points(now.state)))  # fmt: skip
CLOUD_OBJECT = Block("points", 3 * OBJECT_POINTS, "surface of the object, from the palm",
                     lambda now: _cloud(now, now.scenery.points(now.state)))  # fmt: skip
UNUSED = Block("unused", 29, "zero, as published", lambda now: np.zeros((len(now.phase), 29)))
FEATURE = Block("feature", 64, "of an object encoder whose weights are not published: zero, as in the published imitator",
                lambda now: np.zeros((len(now.phase), 64)))  # fmt: skip
