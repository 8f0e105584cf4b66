"""Retargeting targets: the points of a robot hand that correspond to human keypoints, and where they should be.

Every finger has four points: base, middle and distal joint, and tip. A target keeps the direction of the human bone and takes the
length of the robot's bone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.grasping.hand.kinematics import forward_kinematics, joint_limits, points_on_links
from schemas.hand import FINGERS, HandModel

OF_FINGER = 4
LEVEL_1, LEVEL_2, DISTAL, TIP = range(OF_FINGER)


@dataclass(frozen=True, eq=False)
class HandPoints:
    """Correspondence between points of a robot hand and the 21 human keypoints."""

    links: np.ndarray
    """(4 f,) link of each point, finger by finger, from the palm to the tip"""
    offsets_m: np.ndarray
    """(4 f, 3) in the link's frame"""
    keypoint: np.ndarray
    """(f, 4) index of the human keypoint"""
    bones_m: np.ndarray
    """(f, 3) lengths from point to point, at rest"""
    knuckles: np.ndarray
    """(k,) fingers whose bases fix the pose and width of the palm: index, middle, ring, as many as there are"""
    knuckles_m: np.ndarray
    """(k, 3) their bases in the palm frame, at rest"""


def hand_points(hand: HandModel) -> HandPoints:
    """Find the points of a hand; at rest every joint is at 0, or at the limit nearest to 0."""
    fingers = hand.fingers
    links = np.stack([fingers.base_link, fingers.middle_link, fingers.tip_link, fingers.tip_link], axis=1)
    offsets = np.zeros((len(links), OF_FINGER, 3))
    offsets[:, TIP] = fingers.tip_m
    low, high = joint_limits(hand.joints).T
    T = forward_kinematics(hand.joints, np.clip(0.0, low, high)[None])
    T_palm_link = np.linalg.inv(T[:, hand.palm])[:, None] @ T
    rest = points_on_links(T_palm_link, links.ravel(), offsets.reshape(-1, 3))[0].reshape(-1, OF_FINGER, 3)
    wide = [k for k, name in enumerate(fingers.name) if name in ("index", "middle", "ring")]
    knuckles = np.array(wide or [k for k, name in enumerate(fingers.name) if name != "thumb"])
    first = 1 + OF_FINGER * np.array([FINGERS.index(name) for name in fingers.name])
    return HandPoints(links.ravel(), offsets.reshape(-1, 3), first[:, None] + np.arange(OF_FINGER),
                      np.linalg.norm(np.diff(rest, axis=1), axis=-1), knuckles, rest[knuckles, LEVEL_1])


INDEX_MCP, MIDDLE_MCP, RING_MCP, LITTLE_MCP = 5, 9, 13, 17
SHORT_M = 1e-4
"""bones shorter than this have no direction"""


@dataclass(frozen=True, eq=False)
class Targets:
    """Targets of t frames."""

    points_m: np.ndarray
    """(t, f, 4, 3) in the world"""
    pinches_m: np.ndarray
    """(t, f - 1, 3) vectors from the tip of the first finger to the other tips, as in the human hand"""
    palm: np.ndarray
    """(t, 4, 4) pose of the human palm in the robot's palm convention: the initial guess"""


def scaled_targets(hand: HandModel, which: HandPoints, keypoints: np.ndarray, keep_tips: float) -> Targets:
    """Compute targets from keypoints (t, 21, 3).

    Every bone keeps its direction and is scaled by the ratio of the robot's bone to the human median. `keep_tips` = 1 leaves
    fingertips where the human ones are, 0 scales them as well.
    """
    theirs = keypoints[:, which.keypoint]
    bones = np.diff(theirs, axis=2)
    ratio = which.bones_m / np.maximum(np.median(np.linalg.norm(bones, axis=-1), axis=0), SHORT_M)
    centre = theirs[:, which.knuckles, LEVEL_1].mean(axis=1)[:, None]
    base = centre + palm_ratio(which, theirs) * (theirs[:, :, LEVEL_1] - centre)
    chain = base[:, :, None] + np.cumsum(np.pad(bones * ratio[..., None], ((0, 0), (0, 0), (1, 0), (0, 0))), axis=2)
    chain[:, :, TIP] += keep_tips * (theirs[:, :, TIP] - chain[:, :, TIP])
    return Targets(chain, theirs[:, 1:, TIP] - theirs[:, :1, TIP], _palm(hand, which, keypoints, centre[:, 0]))


def palm_ratio(which: HandPoints, theirs: np.ndarray) -> float:
    """Return the ratio of the robot's row of knuckles to the human one, for (t, f, 4, 3); 1 with a single knuckle."""
    if len(which.knuckles) < 2:
        return 1.0
    row = theirs[:, which.knuckles, LEVEL_1]
    wide = np.linalg.norm(row[:, 0] - row[:, -1], axis=-1)
    return float(np.linalg.norm(which.knuckles_m[0] - which.knuckles_m[-1]) / max(float(np.median(wide)), SHORT_M))


def grip_axes(keypoints: np.ndarray, side: str) -> np.ndarray:
    """Compute the axes of the human palm, (t, 21, 3) -> (t, 3, 3): the convention of R_palm_grip.

    Columns: x to a right hand's thumb, y out of the back, z to the fingers.
    """
    z = _unit(keypoints[:, [INDEX_MCP, MIDDLE_MCP, RING_MCP, LITTLE_MCP]].mean(axis=1) - keypoints[:, 0])
    across = (keypoints[:, INDEX_MCP] - keypoints[:, LITTLE_MCP]) * (1.0 if side == "right" else -1.0)
    y = _unit(np.cross(z, across))
    return np.stack([np.cross(y, z), y, z], axis=-1)


def bone_angles(which: HandPoints, ours: np.ndarray, keypoints: np.ndarray) -> np.ndarray:
    """Return the (t,) mean angle in radians between the bones of the robot hand (t, f, 4, 3) and of (t, 21, 3)."""
    a, b = (np.diff(points, axis=2) for points in (ours, keypoints[:, which.keypoint]))
    long = (np.linalg.norm(a, axis=-1) > SHORT_M) & (np.linalg.norm(b, axis=-1) > SHORT_M)
    angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))
    found: np.ndarray = (angle * long).sum(axis=(1, 2)) / np.maximum(long.sum(axis=(1, 2)), 1)
    return found


def _palm(hand: HandModel, which: HandPoints, keypoints: np.ndarray, centre: np.ndarray) -> np.ndarray:
    out = np.tile(np.eye(4), (len(keypoints), 1, 1))
    out[:, :3, :3] = grip_axes(keypoints, hand.side) @ hand.R_palm_grip.T
    out[:, :3, 3] = centre - out[:, :3, :3] @ which.knuckles_m.mean(axis=0)
    return out


def _unit(rows: np.ndarray) -> np.ndarray:
    unit: np.ndarray = rows / np.maximum(np.linalg.norm(rows, axis=-1, keepdims=True), SHORT_M)
    return unit
