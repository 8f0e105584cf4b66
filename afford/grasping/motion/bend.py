"""Bend the fingers of recorded hands: open them on the way to an object, and close them as if nothing were in their way.

Bones keep their lengths. The amounts of the joints are those of the first synergy (skeleton.py), so that 1 closes an open hand.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.motion.skeleton import CLOSING, DIP_OF_PIP, opposing
from afford.grasping.motion.targets import grip_axes

BASE, MIDDLE, THUMB_BASE, THUMB_END = CLOSING
FINGER_RAD = np.cumsum([BASE, MIDDLE, DIP_OF_PIP * MIDDLE])
"""rotation of each bone of a finger at amount 1"""
THUMB_RAD = np.cumsum([THUMB_BASE / 2, THUMB_BASE / 2, THUMB_END])
"""the same of the thumb, whose metacarpal takes half of the first joint"""


def bend_fingers(points: np.ndarray, side: str, amount: np.ndarray) -> np.ndarray:
    """Bend all fingers of keypoints (t, 21, 3) by amounts (t,): negative opens, 1 is a whole closing; (t, 21, 3)."""
    out = np.array(points, np.float64)
    out[:, 1:5] = _bent(out[:, 1:5], _thumb_axis(points), amount[:, None] * THUMB_RAD)
    across = grip_axes(points, side)[:, :, 0]
    for first in range(5, 21, 4):
        chain = out[:, first : first + 4]
        out[:, first : first + 4] = _bent(chain, _off(across, chain[:, -1] - chain[:, 0]), amount[:, None] * FINGER_RAD)
    return out


def _bent(chain: np.ndarray, axis: np.ndarray, rad: np.ndarray) -> np.ndarray:
    """Rotate the bones of chains (t, 4, 3) about axes (t, 3) by angles (t, 3)."""
    turn = Rotation.from_rotvec((axis[:, None] * rad[..., None]).reshape(-1, 3))
    bones = turn.apply(np.diff(chain, axis=1).reshape(-1, 3)).reshape(-1, 3, 3)
    return np.concatenate([chain[:, :1], chain[:, :1] + np.cumsum(bones, axis=1)], axis=1)


def _thumb_axis(points: np.ndarray) -> np.ndarray:
    """Return the (t, 3) axis about which the thumb turns towards the fingertips that it opposes."""
    found = np.cross(points[:, 4] - points[:, 1], opposing(points) - points[:, 1])
    unit: np.ndarray = found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9)
    return unit


def _off(axis: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return the unit component of axes (t, 3) across vectors (t, 3)."""
    unit = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    rest = axis - (axis * unit).sum(axis=1, keepdims=True) * unit
    found: np.ndarray = rest / np.maximum(np.linalg.norm(rest, axis=1, keepdims=True), 1e-9)
    return found
