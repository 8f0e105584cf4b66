"""Forward kinematics, Jacobians and joint coupling of a robot hand: batched, in numpy, from its table of joints.

With the constants of the joints as tensors (`joint_constants`, mapped), kinematics and Jacobians take tensors.

A configuration q is (n, d): all joints that are not fixed, in the order of the table. Coupled joints follow a driver: q = A u + b,
where the command u is (n, m) and holds the joints that have a motor, wrist first.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.common.arrays import namespace
from schemas.hand import HandJoints


def moving_joints(joints: HandJoints) -> np.ndarray:
    """Return the (d,) indices of the joints that are not fixed: the columns of q."""
    return np.array([k for k, kind in enumerate(joints.kind) if kind != "fixed"], np.int64)


def joint_limits(joints: HandJoints) -> np.ndarray:
    """Return the (d, 2) lower and upper limits of the columns of q, rad or m."""
    return np.stack([joints.lower, joints.upper], axis=1)[moving_joints(joints)]


@dataclass(frozen=True, eq=False)
class JointConstants:
    """Constants of j joints, d of which move, and of their l links."""

    kind: tuple[str, ...]
    moving: tuple[int, ...]
    """d joints, the columns of q"""
    parent: tuple[int, ...]
    child: tuple[int, ...]
    identity: np.ndarray
    """(4, 4)"""
    T_parent_joint: np.ndarray
    """(j, 4, 4)"""
    axis: np.ndarray
    """(j, 3)"""
    cross: np.ndarray
    """(j, 3, 3) matrices of the cross products with the axes"""
    cross_twice: np.ndarray
    """(j, 3, 3) their squares"""
    carried: np.ndarray
    """(d,) link that each moving joint carries"""
    moving_axis: np.ndarray
    """(d, 3)"""
    turns: np.ndarray
    """(d,) bool, a moving joint turns; others slide"""
    ancestry: np.ndarray
    """(l, l) bool (`ancestry`)"""


def joint_constants(joints: HandJoints) -> JointConstants:
    """Compute the constants of joints."""
    move, (x, y, z) = moving_joints(joints), joints.axis.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)
    turns = np.array([joints.kind[k] == "revolute" for k in move])
    return JointConstants(joints.kind, tuple(move.tolist()), tuple(joints.parent.tolist()), tuple(joints.child.tolist()), np.eye(4),
                          joints.T_parent_joint, joints.axis, cross, cross @ cross, joints.child[move].astype(np.int64),
                          joints.axis[move], turns, ancestry(joints))  # fmt: skip


def forward_kinematics(joints: HandJoints | JointConstants, q: np.ndarray) -> np.ndarray:
    """Compute the pose of every link: q (n, d) -> T_root_link (n, l, 4, 4).

    q may exceed the limits. ValueError when d is not that of the hand.
    """
    fixed = joints if isinstance(joints, JointConstants) else joint_constants(joints)
    motion = _motions(fixed, q)
    out: np.ndarray = namespace(q).tile(fixed.identity, (len(q), len(fixed.kind) + 1, 1, 1))
    for k, (parent, child) in enumerate(zip(fixed.parent, fixed.child, strict=True)):
        out[:, child] = out[:, parent] @ (fixed.T_parent_joint[k] @ motion[:, k])
    return out


def points_on_links(T: np.ndarray, links: np.ndarray, offsets_m: np.ndarray) -> np.ndarray:
    """Transform points that are fixed to links into the root frame.

    T (n, l, 4, 4) poses of all links, links (k,), offsets_m (k, 3) in the frames of these links -> (n, k, 3).
    """
    found: np.ndarray = namespace(T).einsum("nkij,kj->nki", T[:, links][..., :3, :3], offsets_m) + T[:, links][..., :3, 3]
    return found


def jacobian(joints: HandJoints | JointConstants, T: np.ndarray, links: np.ndarray, offsets_m: np.ndarray) -> np.ndarray:
    """Compute the Jacobian of points on links with respect to q: (n, k, 3, d), m/rad, or m/m for prismatic joints.

    T (n, l, 4, 4) is `forward_kinematics` of the configurations; links (k,) and offsets_m (k, 3) as in `points_on_links`.
    """
    fixed, xp = joints if isinstance(joints, JointConstants) else joint_constants(joints), namespace(T)
    carried = fixed.carried
    axis = xp.einsum("ndij,dj->ndi", T[:, carried][..., :3, :3], fixed.moving_axis)
    arm = points_on_links(T, links, offsets_m)[:, :, None] - T[:, None, carried][..., :3, 3]
    speed = xp.where(fixed.turns[:, None], xp.linalg.cross(axis[:, None], arm), axis[:, None])
    found: np.ndarray = (speed * fixed.ancestry[links][:, carried][..., None]).swapaxes(-1, -2)
    return found


def ancestry(joints: HandJoints) -> np.ndarray:
    """Return (l, l) bool: [a, b] is true when b is link a or an ancestor of link a."""
    out = np.eye(len(joints.name) + 1, dtype=bool)
    for parent, child in zip(joints.parent, joints.child, strict=True):
        out[child] |= out[parent]
    return out


def _motions(fixed: JointConstants, q: np.ndarray) -> np.ndarray:
    """Compute the transform that each joint adds at q, (n, j, 4, 4): Rodrigues' formula, identity for fixed joints."""
    if q.ndim != 2 or q.shape[1] != len(fixed.moving):
        raise ValueError(f"q: expected (n, {len(fixed.moving)}), one column for each joint that moves, got {tuple(q.shape)}")
    xp = namespace(q)
    out: np.ndarray = xp.tile(fixed.identity, (len(q), len(fixed.kind), 1, 1))
    for column, k in enumerate(fixed.moving):
        value = q[:, column, None]
        if fixed.kind[k] == "prismatic":
            out[:, k, :3, 3] = value * fixed.axis[k]
        else:
            turn = xp.sin(value)[..., None] * fixed.cross[k] + (1 - xp.cos(value))[..., None] * fixed.cross_twice[k]
            out[:, k, :3, :3] += turn
    return out


def commanded_joints(joints: HandJoints) -> np.ndarray:
    """Return the (m,) indices of the joints that have a motor, wrist first: the columns of u."""
    return np.array([k for k, role in enumerate(joints.role) if role in ("wrist", "actuated")], np.int64)


def commanded_columns(joints: HandJoints) -> np.ndarray:
    """Return the (m,) columns of q that are commanded: u = q[commanded_columns]."""
    return np.searchsorted(moving_joints(joints), commanded_joints(joints))


def command_limits(joints: HandJoints) -> np.ndarray:
    """Return the (m, 2) lower and upper positions of the commanded joints, rad or m."""
    return np.stack([joints.lower, joints.upper], axis=1)[commanded_joints(joints)]


def coupling_matrix(joints: HandJoints) -> tuple[np.ndarray, np.ndarray]:
    """Return A (d, m) and b (d,) of q = A u + b; a Jacobian with respect to q, times A, is one with respect to u."""
    rows, columns = moving_joints(joints), commanded_joints(joints)
    follows = np.where(joints.driver[rows] < 0, rows, joints.driver[rows])
    ratio = np.where(joints.driver[rows] < 0, 1.0, joints.ratio[rows])
    return (follows[:, None] == columns) * ratio[:, None], joints.offset[rows].copy()
