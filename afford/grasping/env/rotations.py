"""Rotations of n worlds: scipy's for arrays of numpy, the same formulas for tensors. Quaternions are x y z w."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from afford.common.arrays import namespace, taken


def rotation_matrix(quaternion: np.ndarray) -> np.ndarray:
    """(n, 3, 3) rotations of quaternions (n, 4), which are normalized."""
    if isinstance(quaternion, np.ndarray):
        return Rotation.from_quat(quaternion).as_matrix()
    x, y, z, w = _normalized(quaternion).T
    rows = (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 2 * (x * y + z * w), 1 - 2 * (x * x + z * z),
            2 * (y * z - x * w), 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y))  # fmt: skip
    found: np.ndarray = namespace(x).stack(rows, axis=1).reshape(-1, 3, 3)
    return found


def yaw_matrix(yaw: np.ndarray) -> np.ndarray:
    """(n, 3, 3) rotations about the vertical by yaw (n,)."""
    return _about_z(yaw).as_matrix() if isinstance(yaw, np.ndarray) else rotation_matrix(_yaw_quaternion(yaw))


def turned_quaternion(yaw: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(n, 4) quaternions of rotations about the vertical by yaw (n,), after quaternions (n, 4) or rotations (n, 3, 3)."""
    if isinstance(yaw, np.ndarray):
        return (_about_z(yaw) * (Rotation.from_quat(turn) if turn.ndim == 2 else Rotation.from_matrix(turn))).as_quat()
    return _product(_yaw_quaternion(yaw), turn if turn.ndim == 2 else _quaternion(turn))


def turned_euler(yaw: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """(n, 3) Euler angles xyz, about fixed axes, of rotations about the vertical by yaw (n,), after quaternions (n, 4)."""
    if isinstance(yaw, np.ndarray):
        return (_about_z(yaw) * Rotation.from_quat(quaternion)).as_euler("xyz")
    xp, R = namespace(yaw), rotation_matrix(turned_quaternion(yaw, quaternion))
    angles = (xp.arctan2(R[:, 2, 1], R[:, 2, 2]), xp.arcsin(-R[:, 2, 0].clip(-1, 1)), xp.arctan2(R[:, 1, 0], R[:, 0, 0]))
    found: np.ndarray = xp.stack(angles, axis=1)
    return found


def angle_between(quaternion: np.ndarray, R: np.ndarray) -> np.ndarray:
    """(n,) angles between quaternions (n, 4) and rotations (n, 3, 3)."""
    if isinstance(quaternion, np.ndarray):
        return (Rotation.from_quat(quaternion) * Rotation.from_matrix(R).inv()).magnitude()
    xp, back = namespace(quaternion), _quaternion(R)
    difference = _product(quaternion, xp.concatenate([-back[:, :3], back[:, 3:]], axis=1))
    found: np.ndarray = 2 * xp.arctan2(xp.linalg.norm(difference[:, :3], axis=1), xp.abs(difference[:, 3]))
    return found


def _about_z(yaw: np.ndarray) -> Rotation:
    return Rotation.from_rotvec(np.multiply.outer(yaw, [0.0, 0.0, 1.0]))


def _yaw_quaternion(yaw: Any) -> Any:
    xp = namespace(yaw)
    return xp.stack([0 * yaw, 0 * yaw, xp.sin(yaw / 2), xp.cos(yaw / 2)], axis=1)


def _normalized(quaternion: Any) -> Any:
    return quaternion / namespace(quaternion).linalg.norm(quaternion, axis=1)[:, None]


def _product(one: Any, other: Any) -> Any:
    """(n, 4) normalized product of quaternions (n, 4)."""
    xp, (a, w), (b, v) = namespace(one), (one[:, :3], one[:, 3:]), (other[:, :3], other[:, 3:])
    vector = w * b + v * a + xp.linalg.cross(a, b)
    return _normalized(xp.concatenate([vector, w * v - (a * b).sum(axis=1)[:, None]], axis=1))


def _quaternion(R: Any) -> Any:
    """(n, 4) quaternions of rotations (n, 3, 3), from the largest number, as scipy computes them (Markley 2008)."""
    xp, (a, b, c), (d, e, f), (g, h, i) = namespace(R), *(R[:, k].T for k in range(3))
    rows = ((1 + a - e - i, b + d, c + g, h - f), (b + d, 1 + e - a - i, f + h, c - g), (c + g, f + h, 1 + i - a - e, d - b),
            (h - f, c - g, d - b, 1 + a + e + i))  # fmt: skip
    of_each = xp.stack([xp.stack(row, axis=1) for row in rows], axis=1)
    largest = xp.stack([a, e, i, a + e + i], axis=1).argmax(axis=1)
    return _normalized(taken(of_each, largest[:, None, None], axis=1)[:, 0])
