"""Small grasping environments for tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from afford.grasping.env.env import AffordanceGrasp, AffordanceGraspVector
from afford.grasping.env.measures import Measures
from afford.grasping.env.task import Task, make_task
from afford.grasping.hand.kinematics import forward_kinematics, points_on_links
from afford.grasping.motion.retarget import smoothed_rate, twist
from schemas.hand import HandModel, HandReference
from tests.helpers.made_hands import shadow
from tests.helpers.made_motions import trajectory
from tests.helpers.made_scenes import tool


def held_by_handle(category: str = "spatula", seed: int = 12) -> Task:
    """A tool of which only the handle may be touched."""
    body = tool(category, seed)
    return make_task(body, [part for part in body.parts if part != "handle"])


def env(one: Task | None = None, **config: Any) -> AffordanceGrasp:
    """One world."""
    return AffordanceGrasp(shadow(), one or held_by_handle(), **config)


def vector(count: int = 2, **config: Any) -> AffordanceGraspVector:
    """Worlds of a spatula and a screwdriver in turn."""
    return AffordanceGraspVector(count, shadow(), (held_by_handle(), held_by_handle("screwdriver")), **config)


def measured(**given: Any) -> Measures:
    """One world, nothing near anything, but for what is given."""
    far: dict[str, Any] = {
        "palm_m": [1.0], "tips_m": [[1.0] * 5], "allowed_m": [[1.0] * 5], "positive_m": [[0.0] * 5],
        "tips_centre_m": [[1.0] * 5], "goal_m": [1.0], "height_m": [0.0], "N_m": [[1.0] * 5], "N_true_m": [[1.0] * 5],
        "force_held": [[0.0] * 6], "force_negative": [[0.0] * 6], "force_told": [[0.0] * 6],
        "penetration_m": [0.0], "away_m": [0.0], "action": [[0.0] * 24]}  # fmt: skip
    return Measures(**{name: np.array(value, float) for name, value in (far | given).items()})


def reference(hand: HandModel, frames: int = 90, seed: int = 0) -> HandReference:
    """Slow motion of the hand itself above the table, in the form of a retargeted clip."""
    q = trajectory(hand, frames, seed, share=0.3)
    q[:, 2] += 0.6
    T, zero = forward_kinematics(hand.joints, q), np.zeros((len(hand.fingers.name), 3))
    places = (points_on_links(T, hand.fingers.base_link, zero), points_on_links(T, hand.fingers.middle_link, zero),
              points_on_links(T, hand.fingers.tip_link, hand.fingers.tip_m))  # fmt: skip
    return HandReference(f"own_{seed}", hand.name, hand.side, False, 60.0, q, smoothed_rate(q, 60.0), T[:, hand.palm],
                         twist(T[:, hand.palm], 60.0), *places, np.zeros(frames, np.uint8), "", np.zeros((0, 7)), np.eye(4),
                         np.zeros(frames), np.zeros(frames))  # fmt: skip
