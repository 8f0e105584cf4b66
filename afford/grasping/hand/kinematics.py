"""Where the links of a hand are, and how points on them move: batched, in numpy, from the joints table alone.

q is (n, d): the joints that are not fixed, in the order of the table; coupled joints are among them (see coupling.py).
"""

from __future__ import annotations

import numpy as np

from schemas.hand import HandJoints


def moving_joints(joints: HandJoints) -> np.ndarray:
    """(d,) indices of the joints that are not fixed: the columns of q."""
    return np.array([k for k, kind in enumerate(joints.kind) if kind != "fixed"], np.int64)


def joint_limits(joints: HandJoints) -> np.ndarray:
    """(d, 2) lower and upper, rad or m."""
    return np.stack([joints.lower, joints.upper], axis=1)[moving_joints(joints)]


def forward_kinematics(joints: HandJoints, q: np.ndarray) -> np.ndarray:
    """(n, d) -> (n, l, 4, 4) T_root_link, for any q; ValueError when d is not that of the hand."""
    motion = _motions(joints, q)
    out = np.tile(np.eye(4), (len(q), len(joints.name) + 1, 1, 1))
    for k, (parent, child) in enumerate(zip(joints.parent, joints.child, strict=True)):
        out[:, child] = out[:, parent] @ (joints.T_parent_joint[k] @ motion[:, k])
    return out


def points_on_links(T: np.ndarray, links: np.ndarray, offsets_m: np.ndarray) -> np.ndarray:
    """(n, l, 4, 4) poses, (k,) links, (k, 3) offsets in them -> (n, k, 3) in the root's frame."""
    found: np.ndarray = np.einsum("nkij,kj->nki", T[:, links][..., :3, :3], offsets_m) + T[:, links][..., :3, 3]
    return found


def jacobian(joints: HandJoints, T: np.ndarray, links: np.ndarray, offsets_m: np.ndarray) -> np.ndarray:
    """How points on links move with q: (n, k, 3, d), metres per radian (per metre where a joint slides).

    T (n, l, 4, 4) is `forward_kinematics` of the configurations; (k,) links and (k, 3) offsets as in `points_on_links`.
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
    """(l, l) bool: [a, b] is true when link a hangs on link b, or is it."""
    out = np.eye(len(joints.name) + 1, dtype=bool)
    for parent, child in zip(joints.parent, joints.child, strict=True):
        out[child] |= out[parent]
    return out


def _motions(joints: HandJoints, q: np.ndarray) -> np.ndarray:
    """(n, j, 4, 4): what each joint adds at q; Rodrigues' formula, identity where fixed."""
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
    """(m,) indices of the joints that are commanded, wrist first: the columns of u."""
    return np.array([k for k, role in enumerate(joints.role) if role in ("wrist", "actuated")], np.int64)


def commanded_columns(joints: HandJoints) -> np.ndarray:
    """(m,) where the joints that are commanded stand in q: u is q[commanded]."""
    return np.searchsorted(moving_joints(joints), commanded_joints(joints))


def command_limits(joints: HandJoints) -> np.ndarray:
    """(m, 2) lowest and highest position of the joints that are commanded, rad or m."""
    return np.stack([joints.lower, joints.upper], axis=1)[commanded_joints(joints)]


def coupling_matrix(joints: HandJoints) -> tuple[np.ndarray, np.ndarray]:
    """A (d, m) and b (d,): q = A u + b. A Jacobian by q times A is one by u."""
    rows, columns = moving_joints(joints), commanded_joints(joints)
    follows = np.where(joints.driver[rows] < 0, rows, joints.driver[rows])
    ratio = np.where(joints.driver[rows] < 0, 1.0, joints.ratio[rows])
    return (follows[:, None] == columns) * ratio[:, None], joints.offset[rows].copy()
