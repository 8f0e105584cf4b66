"""one clip of a person's hand, a robot hand -> how that hand does the same, or why the clip cannot be imitated.

Reads   HandMotion of one clip; HandModel
Writes  Retargeted: a verdict with its figures, and the HandReference where the clip is kept
Method  bones keep their direction and take the robot's length; Levenberg-Marquardt with the analytic Jacobian over a twist of the
        palm and all motors, every frame alone, then the clip at once with a price on acceleration; limits of joints are kept
        exactly; rules before (length, teleports, bones, side) and after (reach, error, speeds) drop what would be no example
Fails   ValueError, one sentence: a parameter out of range. A clip that breaks a rule does not fail: its verdict says which
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
    level_1: float = 1.0
    """weight of where fingers leave the palm"""
    level_2: float = 1.0
    """weight of the middle and the last joints"""
    tips: float = 2.0
    """weight of fingertips"""
    pinch: float = 2.0
    """weight of the vectors from the thumb's tip to the other tips, where they are short"""
    pinch_m: float = 0.03
    """how short: at this distance their weight is 1/e"""
    acceleration_m: float = 0.001
    """error that is worth 100 rad/s^2 of a joint: more is smoother and less exact"""
    keep_tips: float = 1.0
    """with an object: 1 leaves fingertips where the person has them, 0 where the robot's finger of that shape ends"""
    max_rate_hz: float = 60.0
    """of faster clips every second (third, ...) frame is taken"""
    max_frames: int = 1500
    """longer clips are cut"""
    centre: bool = True
    """turn and shift the world about z: no yaw on average, the object (or else the palm) begins at x = y = 0"""
    mirror: bool = True
    """mirror clips of the other hand; else they are dropped"""
    min_s: float = 0.5
    """shortest clip; a single frame is a pose and stays"""
    max_point_m_s: float = 8.0
    """fastest point of the person's hand: beyond it the tracker has jumped"""
    max_bent_back_m: float = 0.015
    """how far fingertips may be out of the back of the hand in half of the frames; beyond it the side is wrong"""
    max_bone_change: float = 0.5
    """share of its median length by which a bone may be off in 5 % of frames"""
    max_error_m: float = 0.02
    """tracking error that 95 % of frames must keep below"""
    max_joint_rad_s: float = 30.0
    """fastest finger joint"""
    max_palm_m_s: float = 3.0
    """fastest palm"""
    frame_steps: int = 40
    """steps of the solver for every frame alone"""
    clip_steps: int = 15
    """steps of the solver for the whole clip"""


def run(motion: HandMotion, hand: HandModel, params: Params) -> Retargeted:
    """Fit the hand to one clip and judge it."""
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
