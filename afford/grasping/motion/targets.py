"""Where the points of a robot hand should be for it to do what a person's hand does: the same directions, its own lengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.grasping.motion.points import LEVEL_1, TIP, HandPoints
from schemas.hand import HandModel

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


def targets(hand: HandModel, which: HandPoints, keypoints: np.ndarray, keep_tips: float) -> Targets:
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
