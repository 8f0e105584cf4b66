"""Where the points of a robot hand should be for it to do what a person's hand does: the same directions, its own lengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.grasping.hand.kinematics import forward_kinematics, joint_limits, points_on_links
from schemas.hand import FINGERS, HandModel

OF_FINGER = 4
LEVEL_1, LEVEL_2, DISTAL, TIP = range(OF_FINGER)


@dataclass(frozen=True, eq=False)
class HandPoints:
    """Which points of a hand are compared with which of a person's 21."""

    links: np.ndarray
    """(4 f,) link of each point, finger by finger, from the palm to the tip"""
    offsets_m: np.ndarray
    """(4 f, 3) in the link's frame"""
    keypoint: np.ndarray
    """(f, 4) index of the person's point"""
    bones_m: np.ndarray
    """(f, 3) lengths from point to point, at rest"""
    knuckles: np.ndarray
    """(k,) fingers whose bases say where the palm is and how wide: index, middle, ring, as many as there are"""
    knuckles_m: np.ndarray
    """(k, 3) their bases in the palm's frame, at rest"""


def hand_points(hand: HandModel) -> HandPoints:
    """The points of a hand; at rest every joint is at 0, or at the limit that is nearest to it."""
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
    """Of t frames."""

    points_m: np.ndarray
    """(t, f, 4, 3) in the world"""
    pinches_m: np.ndarray
    """(t, f - 1, 3) from the tip of the first finger to those of the others, as the person has them"""
    palm: np.ndarray
    """(t, 4, 4) the person's palm, in the frame of the robot's: where to begin"""


def scaled_targets(hand: HandModel, which: HandPoints, keypoints: np.ndarray, keep_tips: float) -> Targets:
    """keypoints (t, 21, 3) -> what to reach. Every bone keeps its direction and takes the robot's length: its ratio is that of
    the robot's bone to the person's median. `keep_tips` 1 leaves the fingertips where the person has them, 0 scales them too.
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
    """How much wider the robot's row of knuckles is; 1 when it has but one. theirs (t, f, 4, 3)."""
    if len(which.knuckles) < 2:
        return 1.0
    row = theirs[:, which.knuckles, LEVEL_1]
    wide = np.linalg.norm(row[:, 0] - row[:, -1], axis=-1)
    return float(np.linalg.norm(which.knuckles_m[0] - which.knuckles_m[-1]) / max(float(np.median(wide)), SHORT_M))


def grip_axes(keypoints: np.ndarray, side: str) -> np.ndarray:
    """(t, 21, 3) -> (t, 3, 3), columns x to a right hand's thumb, y out of the back, z to the fingers, as R_palm_grip has them."""
    z = _unit(keypoints[:, [INDEX_MCP, MIDDLE_MCP, RING_MCP, LITTLE_MCP]].mean(axis=1) - keypoints[:, 0])
    across = (keypoints[:, INDEX_MCP] - keypoints[:, LITTLE_MCP]) * (1.0 if side == "right" else -1.0)
    y = _unit(np.cross(z, across))
    return np.stack([np.cross(y, z), y, z], axis=-1)


def bone_angles(which: HandPoints, ours: np.ndarray, keypoints: np.ndarray) -> np.ndarray:
    """(t, f, 4, 3) and (t, 21, 3) -> (t,) mean angle in radians between the bones of both hands."""
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
