"""The palm's own axes, from how the middle finger closes: x to a right hand's thumb, y out of the back, z to the fingers."""

from __future__ import annotations

import numpy as np

from afford.grasping.hand.kinematics import forward, limits, moving, points
from schemas.hand import HandFingers, HandJoints

STRAIGHT = ("middle", "index", "ring", "little")
"""the finger that is taken, the first that there is"""
ONE_WAY = 0.2
"""a joint bends one way when its limits are further from even than this share of its range; others swing sideways"""


def grip_axes(joints: HandJoints, fingers: HandFingers, palm: int) -> np.ndarray:
    """(3, 3) rotation, columns x, y, z in the palm's frame: z along the straight finger, -y where its tip goes when it bends."""
    k = next(fingers.name.index(name) for name in STRAIGHT if name in fingers.name)
    root, straight = _finger(joints, fingers, palm, k, 0.0)
    _, bent = _finger(joints, fingers, palm, k, 0.25)
    z = _unit(straight - root)
    back = -(bent - straight)
    y = _unit(back - z * (back @ z))
    return np.stack([np.cross(y, z), y, z], axis=1) + 0.0  # no minus zero


def side(joints: HandJoints, fingers: HandFingers, palm: int, R_palm_grip: np.ndarray) -> str:
    """right when the thumb is on the side of +x, left when it is on that of -x."""
    thumb, _ = _finger(joints, fingers, palm, fingers.name.index("thumb"), 0.0)
    others = [_finger(joints, fingers, palm, k, 0.0)[0] for k, name in enumerate(fingers.name) if name != "thumb"]
    return "right" if (thumb - np.mean(others, axis=0)) @ R_palm_grip[:, 0] > 0 else "left"


def _finger(joints: HandJoints, fingers: HandFingers, palm: int, finger: int, bend: float) -> tuple[np.ndarray, np.ndarray]:
    """Base and tip in the palm's frame; joints at or nearest to 0, those that only bend one way by `bend` of their range."""
    low, high = limits(joints).T
    still = np.clip(0.0, low, high)
    of_finger = np.array([joints.role[k] in ("actuated", "coupled") for k in moving(joints)])
    one_way = of_finger & (np.abs(low + high) > ONE_WAY * (high - low))
    q = np.where(one_way, np.where(high > -low, bend * high, bend * low), still)
    T = forward(joints, q[None])
    links = np.array([fingers.base_link[finger], fingers.tip_link[finger]])
    ends = points(T, links, np.stack([np.zeros(3), fingers.tip_m[finger]]))[0]
    T_palm_root = np.linalg.inv(T[0, palm])
    base, tip = ends @ T_palm_root[:3, :3].T + T_palm_root[:3, 3]
    return base, tip


def _unit(vector: np.ndarray) -> np.ndarray:
    found: np.ndarray = vector / np.linalg.norm(vector)
    return found
