"""Rules that drop clips which cannot serve as demonstrations, before and after retargeting."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from afford.grasping.motion.targets import grip_axes
from schemas.hand import HandModel, HandMotion, RetargetReport, RetargetVerdict

SMALL_M = 0.005
"""bones shorter than this may change in length at will: a webcam tracker measures them poorly"""
UNKNOWN = -1.0
"""a figure that was not computed"""


@dataclass(frozen=True)
class ClipRules:
    """Limits; a clip that exceeds one is dropped."""

    min_s: float
    """shortest clip; a single frame is a pose and may stay"""
    max_point_m_s: float
    """fastest keypoint of the human hand"""
    max_bent_back_m: float
    """median distance of fingertips behind the back of the hand; a larger one means that the side label is wrong"""
    max_bone_change: float
    """deviation of a bone from its median length, as a share of it, exceeded in 5 % of frames"""
    max_error_m: float
    """tracking error that 95 % of frames must stay below"""
    max_joint_rad_s: float
    """fastest finger joint"""
    max_palm_m_s: float
    """fastest palm"""
    mirror: bool
    """mirror clips of the other hand instead of dropping them"""


@dataclass(frozen=True)
class BrokenRule:
    """Rule that a clip breaks."""

    reason: str
    detail: str


def dropped(name: str, source: str, rule: BrokenRule, frames: int = 0, mirrored: bool = False) -> RetargetVerdict:
    """Build the verdict on a clip that was dropped before it was retargeted; its figures are unknown."""
    return RetargetVerdict(name, source, False, rule.reason, rule.detail, mirrored, frames, *[UNKNOWN] * 5)


def report_of(name: str, verdicts: Iterable[RetargetVerdict]) -> RetargetReport:
    """Collect verdicts, by name, with the number of kept clips and of those dropped by each reason, most frequent first."""
    ordered = tuple(sorted(verdicts, key=lambda verdict: verdict.name))
    reasons = Counter(verdict.reason for verdict in ordered if not verdict.kept)
    lines = tuple(f"{reason}: {number}" for reason, number in sorted(reasons.items(), key=lambda item: (-item[1], item[0])))
    return RetargetReport(name, ordered, sum(verdict.kept for verdict in ordered), lines)


def check_motion(motion: HandMotion, hand: HandModel, rules: ClipRules) -> BrokenRule | None:
    """Check a clip before retargeting; None when it breaks no rule."""
    if motion.side != hand.side and not rules.mirror:
        return BrokenRule("other hand", f"a {motion.side} hand; the robot's is the {hand.side} one")
    points, frames = motion.keypoints_m, len(motion.keypoints_m)
    back = bent_back(points, motion.side)
    if back > rules.max_bent_back_m:
        limit = f"{1000 * rules.max_bent_back_m:g} mm"
        return BrokenRule("bends backwards", f"fingertips {1000 * back:.0f} mm of {limit} behind the back of a {motion.side} hand")
    if frames == 1:
        return None
    if frames / motion.rate_hz < rules.min_s:
        return BrokenRule("too short", f"{frames / motion.rate_hz:.3f} s of {rules.min_s:g} s")
    fastest = np.linalg.norm(np.diff(points, axis=0), axis=-1).max(axis=1) * motion.rate_hz
    if fastest.max() > rules.max_point_m_s:
        return BrokenRule("teleport", f"{fastest.max():.1f} m/s of {rules.max_point_m_s:g} m/s after frame {int(fastest.argmax())}")
    change = bone_changes(points)
    if change > rules.max_bone_change:
        return BrokenRule("bones change", f"by {change:.0%} of {rules.max_bone_change:.0%}")
    return None


def check_fit(error_m: np.ndarray, joint_rad_s: float, palm_m_s: float, beyond: tuple[str, float] | None,
          rules: ClipRules) -> BrokenRule | None:
    """Check a fit: error_m (t,), fastest finger joint and palm, and the gantry joint that exceeds its limits."""
    if beyond is not None:
        return BrokenRule("out of reach", f"{beyond[0]} passes its limit by {beyond[1]:.3f}")
    p95 = float(np.percentile(error_m, 95))
    if p95 > rules.max_error_m:
        return BrokenRule("error too large", f"{1000 * p95:.1f} mm of {1000 * rules.max_error_m:g} mm")
    if joint_rad_s > rules.max_joint_rad_s:
        return BrokenRule("joint speed", f"{joint_rad_s:.1f} rad/s of {rules.max_joint_rad_s:g} rad/s")
    if palm_m_s > rules.max_palm_m_s:
        return BrokenRule("palm speed", f"{palm_m_s:.2f} m/s of {rules.max_palm_m_s:g} m/s")
    return None


def bent_back(points: np.ndarray, side: str) -> float:
    """Return the median distance of the four fingertips behind the back of the hand, for (t, 21, 3); negative when curled."""
    return float(np.median(behind_back(points, side)))


def behind_back(points: np.ndarray, side: str) -> np.ndarray:
    """Return the distances (t, 4) of the fingertips behind the back of the hand, for (t, 21, 3); negative when curled."""
    fingers = points[:, [8, 12, 16, 20]] - points[:, [5, 9, 13, 17]]
    behind: np.ndarray = np.einsum("tfc,tc->tf", fingers, grip_axes(points, side)[:, :, 1])
    return behind


def bone_changes(points: np.ndarray) -> float:
    """Return the relative length change of the worst bone of (t, 21, 3), at its 95th percentile over frames."""
    chains = points[:, 1:].reshape(len(points), 5, 4, 3)
    length = np.linalg.norm(np.diff(chains, axis=2), axis=-1).reshape(len(points), -1)
    median = np.median(length, axis=0)
    share = np.abs(length - median) / np.maximum(median, SMALL_M)
    return float(np.percentile(share, 95, axis=0).max())
