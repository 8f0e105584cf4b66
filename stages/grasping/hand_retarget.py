"""one clip of a human hand, a robot hand -> the motion retargeted to the robot hand, or the reason why it was dropped.

Reads   HandMotion of one clip; HandModel
Writes  Retargeted: a verdict with its figures, and the HandReference of a kept clip
Method  bones keep their direction and take the robot's length; Levenberg-Marquardt with the analytic Jacobian over a twist of the
        palm and all motors, first frame by frame, then over the whole clip with a penalty on acceleration; joint limits hold
        exactly; rules before (length, jumps, bones, side) and after (reach, error, speeds) drop unsuitable clips
Fails   ValueError for a parameter out of range. A clip that breaks a rule does not fail: the verdict names the rule
Paper   AffordDex, HTI: Shadow Hand, 24 commands; clips of OakInk2, 120 -> 60 Hz, at most 1500 frames; two levels of joints
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.hand import HandModel, HandMotion, Retargeted

LIBRARIES = ("numpy", "scipy")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of hand_retarget."""

    level_1: float = 1.0
    """weight of the joints where fingers leave the palm"""
    level_2: float = 1.0
    """weight of the middle and the last joints"""
    tips: float = 2.0
    """weight of fingertips"""
    pinch: float = 2.0
    """weight of the vectors from the thumb's tip to the other tips when they are short"""
    pinch_m: float = 0.03
    """distance at which this weight falls to 1/e"""
    acceleration_m: float = 0.001
    """error equivalent to 100 rad/s^2 of a joint: larger is smoother and less exact"""
    keep_tips: float = 1.0
    """with an object: 1 keeps the person's fingertips, 0 puts them at the end of the robot's finger of the same shape"""
    max_rate_hz: float = 60.0
    """faster clips are subsampled by an integer factor"""
    max_frames: int = 1500
    """longer clips are cut"""
    centre: bool = True
    """rotate the world about z and shift it: mean yaw 0, the object (or else the palm) starts at x = y = 0"""
    mirror: bool = True
    """mirror clips of the other side; else they are dropped"""
    min_s: float = 0.5
    """shortest clip; a single frame is a pose and is kept"""
    max_point_m_s: float = 8.0
    """fastest point of the person's hand; a faster one is a jump of the tracker"""
    max_bent_back_m: float = 0.015
    """largest distance of fingertips behind the back of the hand in half of the frames; beyond it the side is wrong"""
    max_bone_change: float = 0.5
    """largest deviation of a bone from its median length in 5 % of frames, as a share of it"""
    max_error_m: float = 0.02
    """largest tracking error in 95 % of frames"""
    max_joint_rad_s: float = 30.0
    """fastest finger joint"""
    max_palm_m_s: float = 3.0
    """fastest palm"""
    frame_steps: int = 40
    """solver steps per frame"""
    clip_steps: int = 15
    """solver steps for the whole clip"""


def run(motion: HandMotion, hand: HandModel, params: Params) -> Retargeted:
    """Fit the hand to one clip and check the result."""
    from afford.grasping.motion.clip_rules import ClipRules
    from afford.grasping.motion.fit import FitWeights
    from afford.grasping.motion.retarget import RetargetOptions, retarget

    _check(params)
    weights = FitWeights(params.level_1, params.level_2, params.tips, params.pinch, params.pinch_m, params.acceleration_m)
    rules = ClipRules(params.min_s, params.max_point_m_s, params.max_bent_back_m, params.max_bone_change, params.max_error_m,
                  params.max_joint_rad_s, params.max_palm_m_s, params.mirror)
    options = RetargetOptions(weights, rules, params.keep_tips, params.max_rate_hz, params.max_frames, params.centre,
                              params.frame_steps, params.clip_steps)  # fmt: skip
    return retarget(motion, hand, options)


def _check(params: Params) -> None:
    positive = ("level_1", "tips", "pinch_m", "max_rate_hz", "max_frames", "max_point_m_s", "max_bone_change", "max_error_m",
                "max_joint_rad_s", "max_palm_m_s", "frame_steps")  # fmt: skip
    least = dict.fromkeys(("level_2", "pinch", "acceleration_m", "max_bent_back_m", "min_s", "clip_steps"), "0 or more")
    for name, wanted in (dict.fromkeys(positive, "a number above zero") | least).items():
        found = getattr(params, name)
        if found < 0 or (found == 0 and name in positive):
            raise ValueError(f"hand_retarget, {name}: expected {wanted}, got {found}")
    if not 0 <= params.keep_tips <= 1:
        raise ValueError(f"hand_retarget, keep_tips: expected 0 to 1, got {params.keep_tips}")
