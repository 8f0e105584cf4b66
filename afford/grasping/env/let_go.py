"""Release of fingers that are near N_t, once the thumb and others hold a raised object.

A hand is as wide as many parts are long, so that fingers of a good grasp reach over its end, above what must not be touched. They
are needed there to grasp and to raise, but seldom to carry. Distances of fingertips to N_t are among what a teacher observes.
"""

from __future__ import annotations

import numpy as np

from afford.grasping.env.carry import is_raised
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.measures import SAFE_M, Measures
from afford.grasping.hand.kinematics import ancestry, command_limits, commanded_joints
from schemas.hand import HandModel

CLEAR_M = SAFE_M + 0.01
"""distance of a fingertip to N_t within which the finger straightens"""
HOLDERS = 2
"""fingers beside the thumb that keep hold, those farthest from N_t"""


def released(now: GraspWorlds, action: np.ndarray) -> np.ndarray:
    """Actions (n, m) in which spare fingers near N_t straighten, where an object is gripped and raised; others as they are."""
    before = now.snapshot()
    leaving = is_raised(before)[:, None] & spare_fingers(before.measures)
    out = action.copy()
    for finger, motors in enumerate(flexing_motors(before.scenery.hand)):
        out[np.ix_(leaving[:, finger], motors)] = -1.0
    return out


def spare_fingers(measured: Measures) -> np.ndarray:
    """(n, f) bool, fingers near N_t that are neither the thumb nor among the HOLDERS that touch farthest from it."""
    touching = measured.touching[:, 1:-1]
    order = np.argsort(np.where(touching, -measured.N_m[:, 1:], np.inf), axis=1, kind="stable")[:, :HOLDERS]
    holds = np.zeros_like(measured.N_m, bool)
    holds[:, 0] = True
    np.put_along_axis(holds[:, 1:], order, np.take_along_axis(touching, order, axis=1), axis=1)
    enough: np.ndarray = holds.sum(axis=1, keepdims=True) > HOLDERS
    return enough & ~holds & (measured.N_m < CLEAR_M)


def flexing_motors(hand: HandModel) -> list[np.ndarray]:
    """Motors of each finger that only flex it: those whose range begins at 0, where the finger is straight."""
    own = commanded_joints(hand.joints)
    of_finger = ancestry(hand.joints)[np.ix_(hand.fingers.tip_link, hand.joints.child[own])]
    wrist = np.array([hand.joints.role[k] == "wrist" for k in own])
    flexes = ~wrist & (command_limits(hand.joints)[:, 0] == 0.0)
    return [np.flatnonzero(mine & flexes) for mine in of_finger]
