"""Shape of clips of recorded grasps: reach, close, hold, lift.

The reach is recorded, or a minimum-jerk path out of the hand's own direction. Fingers then close beyond contact and the palm comes
nearer, as in synthetic clips (motion/synthetic.py), because fingertips that only touch do not lift.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.grasping.motion.bend import bend_fingers
from afford.grasping.motion.skeleton import opposing
from afford.grasping.motion.synthetic import minimum_jerk, minimum_jerk_through
from schemas.hand import PHASES, GraspTarget, HandMotion

SHORT_S = 0.2
"""a recorded reach below this length is replaced by a made one"""
OPENING_AT, OPENING = np.array([0.0, 0.65, 1.0]), np.array([0.6, 1.0, 0.5])
"""shares of a made reach, and of the opening of the fingers at these times: widest at 65 % of the way (Jeannerod 1984)"""


@dataclass(frozen=True)
class ClipShape:
    """Times, lengths and postures of the clips."""

    rate_hz: float
    reach_s: float
    """length of a made reach, and the longest recorded one"""
    close_s: float
    hold_s: float
    lift_s: float
    lift_m: float
    away_m: float
    """distance of the hand from its grasp at the start of a made reach"""
    up: float
    """share of straight up in the direction of the start"""
    opened: float
    """opening of the fingers on the way, as a share of a whole closing"""
    press: float
    """closing beyond contact, as a share of a whole closing"""
    nearer_m: float
    """way of the palm towards the grasp while the fingers press"""
    tilt_deg: float
    """largest tilt between the recorded orientation of the object and the one in which it rests"""


def shaped_clip(motion: HandMotion, way: np.ndarray, target: GraspTarget, shape: ClipShape) -> HandMotion:
    """Build the clip of a motion from the frames (t, 21, 3) up to its grasp, at the motion's rate, in the world of the target."""
    reach = _recorded_reach(way, motion.rate_hz, shape) if (len(way) - 1) / motion.rate_hz >= SHORT_S else None
    reach = _made_reach(way[-1], motion.side, shape) if reach is None else reach
    points, phase = _grasped(reach, motion.side, shape)
    lifting = round(shape.lift_s * shape.rate_hz)
    rise = shape.lift_m * minimum_jerk((np.arange(len(points)) - (len(points) - 1 - lifting)) / lifting)
    points[:, :, 2] += rise[:, None]
    track = np.tile(target.object_pose, (len(points), 1))
    track[:, 2] += rise
    return HandMotion(f"{target.name}_000", motion.source, motion.side, shape.rate_hz, points, phase, target.object_name, track,
                      np.zeros((0, 4, 4)))  # fmt: skip


def _recorded_reach(way: np.ndarray, rate_hz: float, shape: ClipShape) -> np.ndarray:
    """Resample the last `reach_s` seconds of recorded frames (t, 21, 3) at the rate of the clip, linearly."""
    at = (np.arange(len(way)) - (len(way) - 1)) / rate_hz
    wanted = -np.arange(int(min(-at[0], shape.reach_s) * shape.rate_hz + 1e-9), -1, -1) / shape.rate_hz
    rows = np.clip(np.searchsorted(at, wanted, side="right") - 1, 0, len(at) - 2)
    share = ((wanted - at[rows]) * rate_hz)[:, None, None]
    found: np.ndarray = way[rows] + share * (way[rows + 1] - way[rows])
    return found


def _made_reach(grasp: np.ndarray, side: str, shape: ClipShape) -> np.ndarray:
    """Make the frames (t, 21, 3) up to a grasp (21, 3)."""
    start = outwards(grasp) + (0.0, 0.0, shape.up)
    times = np.arange(round(shape.reach_s * shape.rate_hz) + 1) / shape.rate_hz
    left = 1 - minimum_jerk(times / shape.reach_s)
    opening = minimum_jerk_through(times, OPENING_AT * shape.reach_s, OPENING * -shape.opened)
    bent = bend_fingers(np.tile(grasp, (len(times), 1, 1)), side, opening)
    return bent + (left[:, None] * shape.away_m * start / np.linalg.norm(start))[:, None]


def _grasped(way: np.ndarray, side: str, shape: ClipShape) -> tuple[np.ndarray, np.ndarray]:
    """Return the whole clip (t, 21, 3) before the hand rises, and its phases (t,): the reach, then fingers that close and press."""
    closing, holding, lifting = (round(seconds * shape.rate_hz) for seconds in (shape.close_s, shape.hold_s, shape.lift_s))
    after = np.arange(1, closing + holding + lifting + 1)
    share = minimum_jerk(after / max(closing + holding, 1))
    pressed = bend_fingers(np.tile(way[-1], (len(after), 1, 1)), side, shape.press * share)
    pressed -= (shape.nearer_m * share)[:, None, None] * outwards(way[-1])
    words = np.repeat([PHASES.index(word) for word in ("reach", "close", "hold", "lift")], [len(way), closing, holding, lifting])
    return np.concatenate([way, pressed]), words.astype(np.uint8)


def outwards(grasp: np.ndarray) -> np.ndarray:
    """Return the (3,) unit direction from the middle of a grasp (21, 3), between thumb and fingertips, to its palm."""
    back = grasp[[0, 5, 9, 13, 17]].mean(axis=0) - (grasp[4] + opposing(grasp[None])[0]) / 2
    unit: np.ndarray = back / max(float(np.linalg.norm(back)), 1e-9)
    return unit
