"""Clips of people who grasp tools, and the worlds that they are rehearsed in, for tests."""

from __future__ import annotations

from functools import cache
from typing import Any

from afford.grasping.env.arrays import NUMPY, Arrays
from afford.grasping.env.task import make_task
from afford.grasping.imitation.grasp_imitation_env import GraspImitationConfig, GraspImitationWorlds
from maps.settings.grasping import FITTED, MOTION
from schemas.hand import GraspTarget, ReferenceSet
from stages.grasping import grasp_targets, hand_retarget, motion_report, motion_synthesise
from tests.helpers.made_hands import shadow
from tests.helpers.made_scenes import tool
from tests.helpers.read_only import read_only

TOOLS = ("flashlight", "spatula")


@cache
def targets() -> tuple[GraspTarget, ...]:
    """Two places along each tool."""
    places = grasp_targets.Params(places=2)
    return read_only(tuple(one for name in TOOLS for one in grasp_targets.run(tool(name), shadow(), places)))


@cache
def reference_set() -> ReferenceSet:
    """A clip for each of them."""
    clips = [hand_retarget.run(motion_synthesise.run(one, MOTION)[0], shadow(), FITTED) for one in targets()]
    return read_only(motion_report.run(tuple(clips), motion_report.Params()))


def rehearsing(arrays: Arrays = NUMPY, **config: Any) -> GraspImitationWorlds:
    """A world of each tool."""
    return GraspImitationWorlds(shadow(), [make_task(tool(name)) for name in TOOLS], reference_set().references,
                                GraspImitationConfig(**config), arrays=arrays)  # fmt: skip
