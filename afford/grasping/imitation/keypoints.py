"""Keypoints of a robot hand that the paper's imitation reward compares: 10 of level 1 and 12 of level 2 (AffordDex, HTI).

They are the origins of the 22 links that the finger joints of the Shadow Hand carry. Level 1 are the links where fingers leave the
palm, two of every finger; level 2 are the links beyond, and the metacarpal of the little finger. Some origins coincide, as joints
with crossing axes do; their keypoints count twice, as in the released lists of bodies.
"""

from __future__ import annotations

import numpy as np

from afford.grasping.hand.kinematics import forward_kinematics, points_on_links
from schemas.hand import HandModel

LEVEL_1 = ("ffknuckle", "ffproximal", "mfknuckle", "mfproximal", "rfknuckle", "rfproximal", "lfknuckle", "lfproximal", "thbase",
           "thproximal")  # fmt: skip
LEVEL_2 = ("ffmiddle", "ffdistal", "mfmiddle", "mfdistal", "rfmiddle", "rfdistal", "lfmetacarpal", "lfmiddle", "lfdistal", "thhub",
           "thmiddle", "thdistal")  # fmt: skip


def keypoint_links(hand: HandModel) -> tuple[np.ndarray, int]:
    """Return the (k,) links whose origins are keypoints, level 1 first, and the number of level 1.

    A hand without the links of the Shadow Hand has one keypoint of each level per finger: its base and its middle joint.
    """
    if set(LEVEL_1 + LEVEL_2) <= set(hand.links):
        return np.array([hand.links.index(name) for name in LEVEL_1 + LEVEL_2]), len(LEVEL_1)
    fingers = hand.fingers
    return np.concatenate([fingers.base_link, fingers.middle_link]), len(fingers.base_link)


def keypoints_of_links(hand: HandModel, T: np.ndarray) -> np.ndarray:
    """Pick the keypoints (n, k, 3) out of the poses of all links (n, l, 4, 4)."""
    links, _ = keypoint_links(hand)
    return points_on_links(T, links, np.zeros((len(links), 3)))


def keypoints_of_joints(hand: HandModel, q: np.ndarray) -> np.ndarray:
    """Compute the keypoints (t, k, 3) m of joints q (t, d), in the frame of the root."""
    return keypoints_of_links(hand, forward_kinematics(hand.joints, q))
