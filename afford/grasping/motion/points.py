"""The points of a robot hand that stand for a person's keypoints: base, middle and distal joint and tip of every finger."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.grasping.hand.kinematics import forward, limits, points
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
    low, high = limits(hand.joints).T
    T = forward(hand.joints, np.clip(0.0, low, high)[None])
    rest = points(np.linalg.inv(T[:, hand.palm])[:, None] @ T, links.ravel(), offsets.reshape(-1, 3))[0].reshape(-1, OF_FINGER, 3)
    wide = [k for k, name in enumerate(fingers.name) if name in ("index", "middle", "ring")]
    knuckles = np.array(wide or [k for k, name in enumerate(fingers.name) if name != "thumb"])
    first = 1 + OF_FINGER * np.array([FINGERS.index(name) for name in fingers.name])
    return HandPoints(links.ravel(), offsets.reshape(-1, 3), first[:, None] + np.arange(OF_FINGER),
                      np.linalg.norm(np.diff(rest, axis=1), axis=-1), knuckles, rest[knuckles, LEVEL_1])


def keypoints_of(hand: HandModel, T: np.ndarray) -> np.ndarray:
    """(n, l, 4, 4) poses of all links -> (n, 21, 3), as a person's hand would be read; nan for fingers that the hand lacks."""
    which = hand_points(hand)
    out = np.full((len(T), 21, 3), np.nan)
    out[:, 0] = T[:, hand.palm, :3, 3]
    out[:, which.keypoint.ravel()] = points(T, which.links, which.offsets_m)
    return out
