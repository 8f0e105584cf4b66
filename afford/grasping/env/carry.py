"""Carry of a raised object: the wrist moves it to its goal, once a policy has gripped and raised it.

Policies of flat tools learn to grasp and to lift straight up. A thick object has been pushed along the table by then, or turns in
the hand, and ends beside its goal by as much, since its policy never met such distances. Distance and grip are among what a teacher
observes; a proportional controller uses them for the three slides of the wrist. Wrist rotation and fingers are left to the policy.
"""

from __future__ import annotations

import numpy as np

from afford.grasping.env.actions import turned
from afford.grasping.env.grasp_worlds import GraspWorlds
from afford.grasping.env.obs_blocks import Snapshot

RAISED_M = 0.02
"""height of the centre of mass above its place at rest from which an object is carried"""
GAIN = 0.4
"""share of the distance to the goal by which the wrist's targets move in a control step"""
FASTER = 0.25
"""change of an action from one step to the next, at most: a jerk throws the object out of the hand"""


def carried(now: GraspWorlds, action: np.ndarray) -> np.ndarray:
    """Actions (n, m) whose first three numbers move gripped, raised objects to their goals; others as they are."""
    before = now.snapshot()
    centre, raised = now.scenery.centre(before.state), is_raised(before)
    move = np.zeros_like(action)
    move[:, :3] = GAIN * (before.episode.goal - centre)
    wanted = turned(move, -before.episode.yaw)[:, :3] / now.rates[:3, 0]
    wanted /= np.maximum(np.linalg.norm(wanted, axis=1, keepdims=True), 1.0)
    last = before.action[:, :3]
    out = action.copy()
    out[raised, :3] = (last + (wanted - last).clip(-FASTER, FASTER))[raised]
    return out


def is_raised(before: Snapshot) -> np.ndarray:
    """(n,) bool, the object is gripped and above its place at rest."""
    height = before.scenery.centre(before.state)[:, 2] - before.episode.origin[:, 2]
    found: np.ndarray = before.measures.gripped & (height > RAISED_M)
    return found
