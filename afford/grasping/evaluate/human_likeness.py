"""How human a motion of the hand is, from 0 to 10, measured beside motions of people. An offline stand-in for AffordDex's HLS.

The paper asks a vision-language model for a score by three criteria: the trajectory, how smoothly it is run through, and how joints
work together. Here each is a number, and people's own motions say what is usual:

- trajectory: how much longer the palm's way is than two straight lines, from the start down to where it grasps and up to the end;
- smoothness: log dimensionless jerk (Hogan and Sternad 2009) of the palm, and of the fingers' joints, the mean of both;
- coordination: share of the fingers' motion that people's first synergies do not explain (Santello et al. 1998).

A criterion gives 1 up to one standard deviation above the mean of people and falls off exponentially beyond: to 1/e where the
palm's way is 1.28 times as long, jerk 20 times as strong (squared, over the whole), or a quarter more of the motion unexplained.
These scales are fixed, since clean clips are alike to the last digit. The score is 10 times the mean of the three. Nothing is
said by it of whether anything was grasped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schemas.hand import HandReference

CRITERIA = ("trajectory", "smoothness", "coordination")
SYNERGIES = 5
SCALES = np.array([0.25, 3.0, 0.25])
"""how far beyond the usual each criterion has fallen to 1/e"""


@dataclass(frozen=True, eq=False)
class HumanStatistics:
    """What is usual among people."""

    mean: np.ndarray
    """(3,) of each criterion"""
    spread: np.ndarray
    """(3,) standard deviations"""
    posture: np.ndarray
    """(k,) mean of the fingers' joints, rad"""
    synergies: np.ndarray
    """(SYNERGIES, k) orthonormal"""


def human_statistics(references: Sequence[HandReference], rate_hz: float) -> HumanStatistics:
    """Measured at `rate_hz`, the rate of what will be judged. ValueError for fewer than two references."""
    if len(references) < 2:
        raise ValueError(f"likeness: expected two references or more to compare with, got {len(references)}")
    clips = [_clip(one, rate_hz) for one in references]
    joints = np.concatenate([q for q, _ in clips])
    posture = joints.mean(axis=0)
    synergies = np.linalg.svd(joints - posture, full_matrices=False)[2][:SYNERGIES]
    found = np.array([criteria(q, palm, rate_hz, posture, synergies) for q, palm in clips])
    return HumanStatistics(found.mean(axis=0), found.std(axis=0), posture, synergies)


def human_likeness(q: np.ndarray, palm: np.ndarray, rate_hz: float, people: HumanStatistics) -> tuple[float, np.ndarray]:
    """Of fingers' joints (t, k) and the palm's places (t, 3): 0..10, and its three parts (3,) of 0..1."""
    found = criteria(q, palm, rate_hz, people.posture, people.synergies)
    parts = np.exp(-(found - people.mean - people.spread).clip(min=0) / SCALES)
    return float(10 * parts.mean()), parts


def criteria(q: np.ndarray, palm: np.ndarray, rate_hz: float, posture: np.ndarray, synergies: np.ndarray) -> np.ndarray:
    """(3,) detour, log jerk, unexplained share; less is more human."""
    low = int(palm[:, 2].argmin())
    straight = np.linalg.norm(palm[low] - palm[0]) + np.linalg.norm(palm[-1] - palm[low])
    way = np.linalg.norm(np.diff(palm, axis=0), axis=1).sum()
    detour = np.log(max(way, 1e-6) / max(straight, 1e-6))
    jerk = (log_jerk(palm, rate_hz) + log_jerk(q, rate_hz)) / 2
    centred = q - posture
    left = centred - centred @ synergies.T @ synergies
    return np.array([detour, jerk, (left**2).sum() / max((centred**2).sum(), 1e-12)])


def log_jerk(x: np.ndarray, rate_hz: float) -> float:
    """Of a path (t, d): ln of the integral of squared jerk times duration cubed over squared peak speed; no unit. 4.79 for one
    minimum-jerk reach; 0 for one that never moves.
    """
    speed = np.diff(x, axis=0) * rate_hz
    jerk = np.diff(speed, n=2, axis=0) * rate_hz**2
    peak, duration = float((speed**2).sum(axis=1).max(initial=0.0)), len(speed) / rate_hz
    if peak < 1e-12:
        return 0.0
    return float(np.log(max((jerk**2).sum() / rate_hz * duration**3 / peak, 1e-12)))


def _clip(one: HandReference, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    rows = np.unique(np.round(np.arange(0, len(one.q), one.rate_hz / rate_hz)).astype(int).clip(max=len(one.q) - 1))
    return one.q[rows][:, 6:], one.T_world_palm[rows, :3, 3]
