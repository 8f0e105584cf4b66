"""recorded hand motion, the scans that it was recorded on, a hand -> clips of grasps, each in the frame of an episode.

Reads   HandMotions of a source; GraspObjects of its scans; HandModel; GraspTargets of tools
Writes  GraspClips: the target and the motion of each clip; verdicts of the motions that become none, with reasons
Method  the scan is put on the table in the recorded orientation, in which it must rest; the reach is the recorded one, or for a
        single grasp a minimum-jerk path out of the hand's own direction; fingers close beyond contact, the hand lifts. A motion
        without a pose of its object, as from video, gives its posture at the grasp to the tool that fits between the fingertips
Fails   ValueError: a parameter out of range, no motion that becomes a clip
Paper   AffordDex, HTI, takes clips of OakInk2 with their objects. Scans that policies are evaluated on are never used
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.grasp import GraspObject
from schemas.hand import GraspClips, GraspTarget, HandModel, HandMotion

LIBRARIES = ("numpy", "scipy", "trimesh", "mujoco", "pybullet")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of human_motion."""

    data: str = "both"
    """maps/motions.py: clips that `grasp-prior` learns from: synthetic, recorded, or both"""
    prior: str = ""
    """commands/weights.py: folder of a trained prior that `grasp` and `grasp-full` use instead of training one"""
    engine: str = "mujoco"
    """engine in which scans come to rest: mujoco or bullet"""
    rate_hz: float = 20.0
    """frames a second of the clips"""
    reach_s: float = 0.55
    """length of a made reach, and the longest recorded one"""
    close_s: float = 0.2
    """duration of closing after the reach"""
    hold_s: float = 0.25
    """pause before the lift, in which fingers still press"""
    lift_s: float = 0.7
    """duration of the lift"""
    lift_m: float = 0.2
    """height of the lift"""
    away_m: float = 0.12
    """distance of the hand from its grasp at the start of a made reach"""
    up: float = 1.0
    """share of straight up in the direction of the start; the rest is the direction from the fingertips to the palm"""
    opened: float = 0.4
    """opening of the fingers on the way, as a share of a whole closing"""
    press: float = 0.7
    """closing beyond contact, as a share of a whole closing"""
    nearer_m: float = 0.02
    """way of the palm towards the grasp while the fingers press"""
    tilt_deg: float = 20.0
    """largest tilt between the recorded orientation of an object and the one in which it rests"""


def run(motions: tuple[HandMotion, ...], scans: tuple[GraspObject, ...], places: tuple[GraspTarget, ...], hand: HandModel,
        params: Params) -> GraspClips:  # fmt: skip
    """Build all clips."""
    from afford.grasping.imitation.clip_shape import ClipShape
    from afford.grasping.imitation.recorded_clips import grasp_clips

    positive = ("rate_hz", "reach_s", "close_s", "lift_s", "lift_m")
    for name in (*positive, "hold_s", "away_m", "up", "opened", "press", "nearer_m", "tilt_deg"):
        if not (getattr(params, name) > 0 or (getattr(params, name) == 0 and name not in positive)):
            wanted = "a number above zero" if name in positive else "0 or more"
            raise ValueError(f"human_motion, {name}: expected {wanted}, got {getattr(params, name)}")
    shape = ClipShape(params.rate_hz, params.reach_s, params.close_s, params.hold_s, params.lift_s, params.lift_m, params.away_m,
                      params.up, params.opened, params.press, params.nearer_m, params.tilt_deg)  # fmt: skip
    return grasp_clips(motions, scans, places, hand, shape, params.engine)
