"""Forward kinematics, Jacobians and joint coupling of a robot hand: batched, in numpy, from its table of joints.

A configuration q is (n, d): all joints that are not fixed, in the order of the table. Coupled joints follow a driver: q = A u + b,
where the command u is (n, m) and holds the joints that have a motor, wrist first.
"""

from __future__ import annotations

import numpy as np

from schemas.hand import HandJoints


def moving_joints(joints: HandJoints) -> np.ndarray:
    """Return the (d,) indices of the joints that are not fixed: the columns of q."""
    return np.array([k for k, kind in enumerate(joints.kind) if kind != "fixed"], np.int64)


def joint_limits(joints: HandJoints) -> np.ndarray:
    """Return the (d, 2) lower and upper limits of the columns of q, rad or m."""
    return np.stack([joints.lower, joints.upper], axis=1)[moving_joints(joints)]


def forward_kinematics(joints: HandJoints, q: np.ndarray) -> np.ndarray:
    """Compute the pose of every link: q (n, d) -> T_root_link (n, l, 4, 4).

    q may exceed the limits. ValueError when d is not that of the hand.
    """
    motion = _motions(joints, q)
    out = np.tile(np.eye(4), (len(q), len(joints.name) + 1, 1, 1))
    for k, (parent, child) in enumerate(zip(joints.parent, joints.child, strict=True)):
        out[:, child] = out[:, parent] @ (joints.T_parent_joint[k] @ motion[:, k])
    return out


def points_on_links(T: np.ndarray, links: np.ndarray, offsets_m: np.ndarray) -> np.ndarray:
    """Transform points that are fixed to links into the root frame.

    T (n, l, 4, 4) poses of all links, links (k,), offsets_m (k, 3) in the frames of these links -> (n, k, 3).
    """
    found: np.ndarray = np.einsum("nkij,kj->nki", T[:, links][..., :3, :3], offsets_m) + T[:, links][..., :3, 3]
    return found


def jacobian(joints: HandJoints, T: np.ndarray, links: np.ndarray, offsets_m: np.ndarray) -> np.ndarray:
    """Compute the Jacobian of points on links with respect to q: (n, k, 3, d), m/rad, or m/m for prismatic joints.

    T (n, l, 4, 4) is `forward_kinematics` of the configurations; links (k,) and offsets_m (k, 3) as in `points_on_links`.
    """
    move = moving_joints(joints)
    carried = joints.child[move]
    axis = np.einsum("ndij,dj->ndi", T[:, carried][..., :3, :3], joints.axis[move])
    arm = points_on_links(T, links, offsets_m)[:, :, None] - T[:, None, carried][..., :3, 3]
    turns = np.array([joints.kind[k] == "revolute" for k in move])
    speed = np.where(turns[:, None], np.cross(axis[:, None], arm), axis[:, None])
    speed = speed * ancestry(joints)[np.ix_(links, carried)][..., None]
    return np.swapaxes(speed, -1, -2)


def ancestry(joints: HandJoints) -> np.ndarray:
    """Return (l, l) bool: [a, b] is true when b is link a or an ancestor of link a."""
    out = np.eye(len(joints.name) + 1, dtype=bool)
    for parent, child in zip(joints.parent, joints.child, strict=True):
        out[child] |= out[parent]
    return out


def _motions(joints: HandJoints, q: np.ndarray) -> np.ndarray:
    """Compute the transform that each joint adds at q, (n, j, 4, 4): Rodrigues' formula, identity for fixed joints."""
    move = moving_joints(joints)
    if q.ndim != 2 or q.shape[1] != len(move):
        raise ValueError(f"q: expected (n, {len(move)}), one column for each joint that moves, got {q.shape}")
    out = np.tile(np.eye(4), (len(q), len(joints.name), 1, 1))
    for column, k in enumerate(move):
        value = q[:, column, None]
        if joints.kind[k] == "prismatic":
            out[:, k, :3, 3] = value * joints.axis[k]
        else:
            x, y, z = joints.axis[k]
            K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            out[:, k, :3, :3] += np.sin(value)[..., None] * K + (1 - np.cos(value))[..., None] * (K @ K)
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
