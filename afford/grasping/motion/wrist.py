"""The pose of a palm -> positions of the gantry that carries it: x, y, z, yaw, pitch, roll."""

from __future__ import annotations

import numpy as np

from afford.grasping.hand.gantry import STEPS
from afford.grasping.hand.kinematics import forward, limits, moving
from schemas.hand import HandModel

LOCKED = 1e-4
"""cosine of the pitch below which yaw and roll are the same turn: the yaw of the frame before is kept"""


def has_gantry(hand: HandModel) -> bool:
    """Whether the first six joints are a gantry's; all others may be anything."""
    return hand.joints.name[: len(STEPS)] == tuple(f"wrist_{step}" for step in STEPS)


def on_gantry(hand: HandModel, q: np.ndarray, T_world_palm: np.ndarray) -> np.ndarray:
    """q (t, d) whose first six columns are put so that the palm is at (t, 4, 4); angles do not jump by a turn from frame to frame.

    Not cut at limits. A hand without a gantry keeps q: its root is free, and the palm's pose says where it is.
    """
    if not has_gantry(hand):
        return q
    still = forward(hand.joints, np.concatenate([np.zeros((len(q), 6)), q[:, 6:]], axis=1))
    T = T_world_palm @ np.linalg.inv(still[:, hand.palm])
    R = T[:, :3, :3]
    pitch = np.arcsin(np.clip(-R[:, 2, 0], -1, 1))
    yaw = _held(np.arctan2(R[:, 1, 0], R[:, 0, 0]), np.hypot(R[:, 0, 0], R[:, 1, 0]) < LOCKED)
    cos, sin = np.cos(yaw), np.sin(yaw)
    roll = np.arctan2(sin * R[:, 0, 2] - cos * R[:, 1, 2], cos * R[:, 1, 1] - sin * R[:, 0, 1])
    out = q.copy()
    out[:, :6] = np.stack([*T[:, :3, 3].T, _continuous(yaw), pitch, _continuous(roll)], axis=1)
    return out


def beyond(hand: HandModel, q: np.ndarray) -> tuple[str, float] | None:
    """The joint of the gantry that passes its limits most, and by how much; None when none does."""
    if not has_gantry(hand):
        return None
    low, high = limits(hand.joints)[:6].T
    over = np.maximum(low - q[:, :6], q[:, :6] - high).max(axis=0)
    worst = int(over.argmax())
    return (hand.joints.name[moving(hand.joints)[worst]], float(over[worst])) if over[worst] > 0 else None


def _held(angle: np.ndarray, locked: np.ndarray) -> np.ndarray:
    """The last value before, or the first after, where locked; 0 where all are."""
    if locked.all():
        return np.zeros_like(angle)
    known = np.flatnonzero(~locked)
    before = np.searchsorted(known, np.arange(len(angle)), side="right") - 1
    held: np.ndarray = angle[known[np.maximum(before, 0)]]
    return held


def _continuous(angle: np.ndarray) -> np.ndarray:
    """Unwrapped, and as near to 0 as whole turns can bring its middle."""
    out = np.unwrap(angle)
    return out - 2 * np.pi * np.round((out.max() + out.min()) / (4 * np.pi))
