"""Small grasping environments for tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from afford.grasp.env import AffordanceGrasp, AffordanceGraspVector
from afford.grasp.measures import Measures
from afford.grasp.task import Task, task
from tests.made_hands import shadow
from tests.made_scenes import tool


def held_by_handle(category: str = "spatula", seed: int = 12) -> Task:
    """A tool of which only the handle may be touched."""
    body = tool(category, seed)
    return task(body, [part for part in body.parts if part != "handle"])


def env(one: Task | None = None, **config: Any) -> AffordanceGrasp:
    """One world."""
    return AffordanceGrasp(shadow(), one or held_by_handle(), **config)


def vector(count: int = 2, **config: Any) -> AffordanceGraspVector:
    """Worlds of a spatula and a screwdriver in turn."""
    return AffordanceGraspVector(count, shadow(), (held_by_handle(), held_by_handle("screwdriver")), **config)


def measured(**given: Any) -> Measures:
    """One world, nothing near anything, but for what is given."""
    far: dict[str, Any] = {
        "palm_m": [1.0], "tips_m": [[1.0] * 5], "tips_centre_m": [[1.0] * 5], "goal_m": [1.0], "height_m": [0.0],
        "N_m": [[1.0] * 5], "force_held": [[0.0] * 6], "force_negative": [[0.0] * 6], "penetration_m": [0.0], "away_m": [0.0],
        "action": [[0.0] * 24]}  # fmt: skip
    return Measures(**{name: np.array(value, float) for name, value in (far | given).items()})
