"""Clips of people who grasp tools, and the worlds that they are rehearsed in, for tests."""

from __future__ import annotations

from functools import cache
from typing import Any

from afford.grasp.rehearse import Rehearsal, Rehearsing
from afford.grasp.task import task
from schemas.motion import GraspTarget, ReferenceSet
from stages import grasp_targets, hand_retarget, motion_report, motion_synthesise
from tests.made_hands import shadow
from tests.made_scenes import tool
from tests.read_only import read_only

TOOLS = ("flashlight", "spatula")
FROM_ABOVE = motion_synthesise.Params(
    clips=1, rate_hz=20.0, reach_s=(0.45, 0.55), close_s=(0.2, 0.25), hold_s=0.25, lift_s=0.7, distance_m=(0.115, 0.125),
    approach=(0.0, -0.741, -0.672), start=(0.0, 0.0, 20.0), wander=0.3, beyond_m=(0.0, -0.009, -0.0242), spread_deg=4.0,
    turn_deg=5.0, hooking=(-0.41, -0.21), press=0.99, noise_m=0.0)  # fmt: skip


@cache
def targets() -> tuple[GraspTarget, ...]:
    """Two places along each tool."""
    places = grasp_targets.Params(places=2)
    return read_only(tuple(one for name in TOOLS for one in grasp_targets.run(tool(name), shadow(), places)))


@cache
def reference_set() -> ReferenceSet:
    """A clip for each of them."""
    plain = hand_retarget.Params(centre=False, frame_steps=20, clip_steps=5)
    clips = [hand_retarget.run(motion_synthesise.run(one, FROM_ABOVE)[0], shadow(), plain) for one in targets()]
    return read_only(motion_report.run(tuple(clips), motion_report.Params()))


def rehearsing(**config: Any) -> Rehearsing:
    """A world of each tool."""
    return Rehearsing(shadow(), [task(tool(name)) for name in TOOLS], reference_set().references, Rehearsal(**config))
