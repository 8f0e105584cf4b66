"""Where a person's wrist is when the hand holds a handle: across it, the thumb opposite to the fingers, from one side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.motion.skeleton import closings, opposing, posed
from schemas.hand import GraspTarget

PAD_M = 0.006
"""from a tracked fingertip to the skin that touches"""
FROM_FRONT_AND_ABOVE = np.array([0.0, 1.0, -1.0]) / np.sqrt(2)
"""the person sits at -y"""


@dataclass(frozen=True, eq=False)
class Grip:
    """A grasp of a handle."""

    T_world_wrist: np.ndarray
    """(4, 4)"""
    approach: np.ndarray
    """(3,) unit direction in which the hand comes, across the handle"""
    size_m: float
    """aperture that touches both sides"""


def grip_at(target: GraspTarget, hooking: float, turn_rad: float, come: np.ndarray = FROM_FRONT_AND_ABOVE) -> Grip:
    """The grasp whose approach is turned about the handle by `turn_rad` from the direction `come` (3,), of which what lies along
    the handle is left out. Of the two grasps of that approach it is the one with the back of the hand up. ValueError when the
    hand does not fit.
    """
    size = target.diameter_m + 2 * PAD_M
    wide, amount = closings(hooking)
    if not wide[0] <= size <= wide[-1]:
        low, high = (1000 * (end - 2 * PAD_M) for end in (wide[0], wide[-1]))
        raise ValueError(f"{target.name}, diameter_m: expected {max(low, 0):.0f} to {high:.0f} mm, which a hand can span, got "
                         f"{1000 * target.diameter_m:.0f} mm")
    points = posed(np.array([np.interp(size, wide, amount)]), np.array([hooking]))
    thumb, fingers = points[0, 4], opposing(points)[0]
    centre = (thumb + fingers) / 2
    handle = _world(target)
    axis, approach = handle[:3, 2], _approach(handle[:3, 2], turn_rad, come)
    across = _off(np.array([1.0, 0.0, 0.0]), _unit(fingers - thumb))
    local = np.stack([across, forward := _off(centre, across), np.cross(across, forward)], axis=1)
    turns = [np.stack([sign * axis, approach, np.cross(sign * axis, approach)], axis=1) @ local.T for sign in (1.0, -1.0)]
    T = np.eye(4)
    T[:3, :3] = max(turns, key=lambda R: float(R[2, 1]))
    T[:3, 3] = handle[:3, 3] - T[:3, :3] @ centre
    return Grip(T, approach, size)


def _world(target: GraspTarget) -> np.ndarray:
    """(4, 4) pose of the handle in the world."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(target.object_pose[3:]).as_matrix()
    T[:3, 3] = target.object_pose[:3]
    found: np.ndarray = T @ target.T_object_handle
    return found


def _approach(axis: np.ndarray, turn_rad: float, come: np.ndarray) -> np.ndarray:
    come = _unit(come)
    across = come - (come @ axis) * axis
    if np.linalg.norm(across) < 0.1:
        across = np.array([1.0, 0.0, 0.0])
    found: np.ndarray = Rotation.from_rotvec(axis * turn_rad).apply(_unit(across))
    return found


def _off(vector: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """The unit part of a vector that is square to a unit axis."""
    return _unit(vector - (vector @ axis) * axis)


def _unit(vector: np.ndarray) -> np.ndarray:
    unit: np.ndarray = vector / np.linalg.norm(vector)
    return unit
