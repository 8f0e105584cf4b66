"""Kinematic skeleton of a human right hand with 21 points, posed by two synergies of its joint angles.

Frame of the wrist: x to the thumb, y out of the back, z to the fingers. Lengths are shares of the hand's length: phalanges after
Buchholz, Armstrong and Goldstein 1992; knuckles and thumb as keypoint trackers place them. DIP = 2/3 PIP (Rijpkema and Girard
1991). The synergies follow the first two of Santello, Flanders and Soechting 1998, which explain more than 80 % of the variance of
grasps: all joints close together; knuckles bend while middle joints extend. Their sizes in degrees are our own.
"""

from __future__ import annotations

import numpy as np

from schemas.hand import KEYPOINTS

HAND_M = 0.19
KNUCKLES = np.array([[0.14, 0.44], [0.03, 0.445], [-0.07, 0.415], [-0.155, 0.38]])
"""index to little: x and z of the MCP joints"""
PHALANGES = np.array([[0.245, 0.143, 0.097], [0.266, 0.170, 0.108], [0.244, 0.165, 0.107], [0.204, 0.117, 0.093]])
THUMB_BASE = np.array([0.13, -0.07, 0.13])
THUMB_BONES = np.array([0.20, 0.185, 0.158])
THUMB_OPEN, THUMB_CLOSED = np.array([0.48, -0.74, 0.48]), np.array([0.22, -0.48, 0.85])
"""directions of the metacarpal, which opposes the fingers at all times"""
THUMB_BENDS_TO = np.array([-0.9, -0.1, 0.45])
DIP_OF_PIP = 2 / 3
MEAN = np.deg2rad([12.0, 15.0, 12.0, 15.0])
"""MCP and PIP of the fingers, MCP and IP of the thumb, of an open hand"""
CLOSING = np.deg2rad([62.0, 75.0, 45.0, 45.0])
"""first synergy: added by a closed hand"""
HOOKING = np.deg2rad([18.0, -22.0, 0.0, -12.0])
"""second synergy: knuckles bend, middle joints extend"""
SPREAD = np.deg2rad([8.0, 2.0, -4.0, -10.0])
"""open fingers fan out; closed fingers do not"""


def pose_hand(closing: np.ndarray, hooking: np.ndarray, hand_m: float = HAND_M) -> np.ndarray:
    """Pose the hand: (n,) amplitudes of the two synergies, 0..1 and -1..1 -> (n, 21, 3) in the wrist frame, metres."""
    bends = MEAN + closing[:, None] * CLOSING + hooking[:, None] * HOOKING
    out = np.zeros((len(closing), len(KEYPOINTS), 3))
    out[:, 1:5] = _thumb(closing, bends[:, 2], bends[:, 3])
    for finger in range(4):
        out[:, 5 + 4 * finger : 9 + 4 * finger] = _finger(finger, SPREAD[finger] * (1 - closing), bends[:, 0], bends[:, 1])
    return out * hand_m


def aperture(points: np.ndarray) -> np.ndarray:
    """Return the (n,) distance from the thumb's tip to the midpoint of the index and the middle fingertip."""
    found: np.ndarray = np.linalg.norm(opposing(points) - points[:, 4], axis=-1)
    return found


def opposing(points: np.ndarray) -> np.ndarray:
    """Return the (n, 3) midpoint of the index and the middle fingertip, which the thumb opposes."""
    middle: np.ndarray = points[:, [8, 12]].mean(axis=1)
    return middle


def closings(hooking: float, hand_m: float = HAND_M) -> tuple[np.ndarray, np.ndarray]:
    """Tabulate apertures in metres, rising, and the closing that produces each.

    The range is from the widest to the narrowest aperture that closing reaches.
    """
    amount = np.linspace(0.0, 1.0, 401)
    wide = aperture(pose_hand(amount, np.full_like(amount, hooking), hand_m))
    part = slice(int(wide.argmax()), int(wide.argmin()) + 1)
    falling = np.minimum.accumulate(wide[part])
    return falling[::-1], amount[part][::-1]


def _finger(finger: int, spread: np.ndarray, mcp: np.ndarray, pip: np.ndarray) -> np.ndarray:
    along = np.stack([np.sin(spread), np.zeros_like(spread), np.cos(spread)], axis=-1)
    bend = np.cumsum(np.stack([mcp, pip, DIP_OF_PIP * pip], axis=-1), axis=-1)[..., None]
    bones = (np.cos(bend) * along[:, None] + np.sin(bend) * np.array([0.0, -1.0, 0.0])) * PHALANGES[finger, :, None]
    base = np.broadcast_to([KNUCKLES[finger, 0], 0.0, KNUCKLES[finger, 1]], (len(mcp), 1, 3))
    return np.concatenate([base, base + np.cumsum(bones, axis=1)], axis=1)


def _thumb(closing: np.ndarray, mcp: np.ndarray, ip: np.ndarray) -> np.ndarray:
    """Pose the thumb in the plane of its metacarpal and its bending direction."""
    along = _unit(THUMB_OPEN + closing[:, None] * (THUMB_CLOSED - THUMB_OPEN))
    across = _unit(THUMB_BENDS_TO - (along @ THUMB_BENDS_TO)[:, None] * along)
    bend = np.cumsum(np.stack([np.zeros_like(mcp), mcp, ip], axis=-1), axis=-1)[..., None]
    bones = (np.cos(bend) * along[:, None] + np.sin(bend) * across[:, None]) * THUMB_BONES[:, None]
    base = np.broadcast_to(THUMB_BASE, (len(mcp), 1, 3))
    return np.concatenate([base, base + np.cumsum(bones, axis=1)], axis=1)


def _unit(rows: np.ndarray) -> np.ndarray:
    unit: np.ndarray = rows / np.linalg.norm(rows, axis=-1, keepdims=True)
    return unit
