"""Grasping worlds in which the hand begins over a place of a grasp family (families.py), and carries what it has raised.

Starts are those of the tools on which policies are trained: the same depth below the top of a body, and the palm as near to the
surface of a wide part as to that of a handle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.carried_worlds import CarriedWorlds
from afford.grasping.env.config import GraspEnvConfig
from afford.grasping.env.families import GraspPlace
from afford.grasping.env.flight_recorder import FlightRecorder
from afford.grasping.env.rest_choice import places_of
from afford.grasping.env.task import from_grasp_task
from afford.grasping.sim.scripted import Aim
from schemas.grasp import GraspTask
from schemas.hand import HandModel

LYING = 0.5
"""an axis lies when its horizontal part is longer than this"""
REACH_M, BESIDE_M = 0.04, 0.05
"""depth that the hand reaches below the top of what is within BESIDE_M of a place"""
DEEP_M = 0.015
"""depth below the top of a lying part itself"""
TOOL_M = 0.03
"""width of a tool's handle; the hand stays back from the middle of wider parts by half of what they have more, and begins over the
surface of an upright body"""


class PlacedWorlds(CarriedWorlds):
    """n worlds whose hands begin over the best place of their tasks."""

    def __init__(self, hand: HandModel, tasks: Sequence[GraspTask], config: GraspEnvConfig, carry: bool = True,
                 recorder: FlightRecorder | None = None) -> None:  # fmt: skip
        """Build the worlds; `carry` raised objects to their goals. ValueError for a task without a place."""
        self.places, self.given, self.carry = [best_place(one) for one in tasks], tuple(tasks), carry
        super().__init__(hand, [from_grasp_task(one) for one in tasks], config, recorder)

    def _aim(self, k: int, pose: np.ndarray, rng: np.random.Generator) -> Aim:
        return aim_at_place(self.places[k], pose, self.scenery.com[k])


def best_place(task: GraspTask) -> GraspPlace:
    """Best place of a task, as high as the hand reaches. ValueError without one."""
    places = places_of(task)
    if not places:
        raise ValueError(f"{task.name}: expected a part that a hand can hold, got none; body_tasks refuses such tasks")
    return _reached(places[0], task.body.points.astype(np.float64))


def _reached(place: GraspPlace, points: np.ndarray) -> GraspPlace:
    """Raise a place to where fingers reach it from above, so that the hand does not begin inside the body around it."""
    away = np.linalg.norm((points - place.at_m)[:, :2], axis=1)
    lies = np.linalg.norm(place.along[:2]) >= LYING
    around, part = (float(points[away < near, 2].max(initial=-np.inf)) for near in (BESIDE_M, place.width_m / 2 if lies else 0.0))
    return replace(place, at_m=np.append(place.at_m[:2], max(place.at_m[2], around - REACH_M, part - DEEP_M)))


def aim_at_place(place: GraspPlace, pose: np.ndarray, com_m: np.ndarray) -> Aim:
    """Aim at a place of an object at the pose (7,), whose centre of mass `com_m` (3,) is in its own frame.

    The yaw is that of the gripped axis, towards the centre of mass. For an upright axis, the hand comes from the side of the
    approach. It stays back from the middle of wide parts, which it would push away.
    """
    yaw, at = _frame(place, pose, com_m)
    back = place.width_m / 2 if place.family == "body" else max(0.0, (place.width_m - TOOL_M) / 2)
    return Aim(at + back * np.array([-np.sin(yaw), np.cos(yaw), 0.0]), yaw)


def _frame(place: GraspPlace, pose: np.ndarray, com_m: np.ndarray) -> tuple[float, np.ndarray]:
    """Yaw of the gripped axis, and the middle of the gripped part in the world."""
    turn = Rotation.from_quat(pose[3:])
    at, along, approach = turn.apply(place.at_m) + pose[:3], turn.apply(place.along), turn.apply(place.approach)
    if np.linalg.norm(along[:2]) < LYING:
        return float(np.arctan2(approach[0], -approach[1])), at
    towards = (turn.apply(com_m) + pose[:3] - at)[:2] @ along[:2]
    x, y = along[:2] if towards >= 0 else -along[:2]
    return float(np.arctan2(y, x)), at
