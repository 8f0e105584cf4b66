"""Blocks for a perceptron that is to learn in minutes: places, spreads and distances in the frame of the episode."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from afford.grasping.env.measures import nearest
from afford.grasping.env.moment import Block, Now, columns, spread
from afford.grasping.env.scenery import to_frame
from afford.grasping.env.task import NEGATIVE_POINTS

FAR_M = 0.3
"""distances are cut off here"""
PRESS_N = 5.0
"""forces are in units of it, and cut off at 2"""


def fingers_q(now: Now) -> np.ndarray:
    return now.state.q[:, 6:]


def _palm(now: Now) -> np.ndarray:
    yaw = now.episode.yaw
    return np.concatenate([now.spot(now.scenery.palm(now.state), yaw), columns(now.state.palm[:, 3:], yaw)], axis=1)


def _press(force: np.ndarray) -> np.ndarray:
    return (force / PRESS_N).clip(0, 2)


def _object(now: Now) -> np.ndarray:
    yaw, state = now.episode.yaw, now.state
    centre = now.scenery.centre(state)
    parts = (now.spot(centre, yaw), columns(state.body[:, 3:], yaw), to_frame(state.velocity, yaw), 0.2 * to_frame(state.spin, yaw),
             to_frame(now.episode.goal - centre, yaw))  # fmt: skip
    return np.concatenate(parts, axis=1)


def _whole(now: Now) -> np.ndarray:
    points = now.scenery.points(now.state)
    return spread(points, np.ones(points.shape[:2], bool), now.scenery.palm(now.state), now.episode.yaw)


def _allowed(now: Now) -> np.ndarray:
    return spread(now.scenery.points(now.state), now.scenery.allowed, now.scenery.palm(now.state), now.episode.yaw)


def _to_surface(now: Now) -> np.ndarray:
    found = nearest(now.state.tips, now.scenery.points(now.state))[1]
    return to_frame(found - now.state.tips, now.episode.yaw).clip(-FAR_M, FAR_M)


def _negative(now: Now) -> np.ndarray:
    there = np.repeat(now.scenery.any_negative[:, None], NEGATIVE_POINTS, axis=1)
    return spread(now.scenery.negative_points(now.state), there, now.scenery.palm(now.state), now.episode.yaw)


def _tips_negative(now: Now) -> np.ndarray:
    return now.measures.N_m.clip(max=FAR_M)


def _phase(now: Now) -> np.ndarray:
    return np.stack([now.phase, np.cos(np.pi * now.phase)], axis=1)


SMALL: Mapping[str, tuple[Block, ...]] = {
    "R": (
        Block("joints", 22, "of the fingers, rad", fingers_q),
        Block("palm", 9, "middle of the palm; two columns of its rotation", _palm),
        Block("tips", 15, "fingertips, m", lambda now: now.spot(now.state.tips, now.episode.yaw)),
        Block("press", 6, "each finger and the palm on the object, 5 N", lambda now: _press(now.state.force.sum(axis=2))),
        Block("offset", 24, "how far actions have moved targets, in full actions", lambda now: now.offset),
        Block("lag", 18, "how far the fingers' targets are from the joints, in full actions, within 5",
              lambda now: now.lag[:, 6:].clip(-5, 5)),
        Block("phase", 2, "share of the episode that is over, and the cosine of half a turn of it", _phase),
    ),
    "O": (Block("object", 18, "centre of mass; two columns of its rotation; velocity; spin x 0.2; way to the goal", _object),),
    "P": (
        Block("whole", 6, "points of the object: mean, from the middle of the palm, and spread, m", _whole),
        Block("tips_object", 5, "from fingertips to the surface, m, within 0.3", lambda now: now.measures.tips_m.clip(max=FAR_M)),
        Block("to_surface", 15, "from each fingertip to the nearest point of the surface, m", _to_surface),
    ),
    "N": (
        Block("negative", 6, "negative points: mean, from the middle of the palm, and spread, m; 0 where none", _negative),
        Block("allowed", 6, "the same of the object's points that are farther than 2 cm from all negative ones", _allowed),
        Block("tips_N", 5, "from fingertips to the nearest negative point, m, within 0.3", _tips_negative),
        Block("press_N", 6, "each finger and the palm on parts that N_t says are negative, 5 N",
              lambda now: _press(now.measures.force_told)),
        Block("any_negative", 1, "whether there are any", lambda now: now.scenery.any_negative[:, None].astype(float)),
    ),
}  # fmt: skip
