"""Score the human likeness of a hand motion from 0 to 10: an offline substitute for AffordDex's HLS.

The paper prompts a vision-language model for a score by three criteria: the trajectory, its smoothness, and the coordination of
joints. Here each is a number, and human motions define the usual range:

- trajectory: length of the palm's path relative to two straight lines, from the start down to the grasp and up to the end;

- smoothness: log dimensionless jerk (Hogan and Sternad 2009), the mean of that of the palm and that of the finger joints;

- coordination: share of the finger motion that the first human synergies do not explain (Santello et al. 1998).

A criterion scores 1 up to one standard deviation above the human mean and falls exponentially beyond: to 1/e where the path is
1.28 times as long, jerk 20 times as strong (squared, integrated), or a quarter more of the motion unexplained. These scales are
fixed, because clean clips hardly differ. The result is 10 times the mean of the three. It does not depend on the success of the
grasp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from schemas.hand import HandReference

CRITERIA = ("trajectory", "smoothness", "coordination")
SYNERGIES = 5
SCALES = np.array([0.25, 3.0, 0.25])
"""excess over the usual at which each criterion has fallen to 1/e"""


@dataclass(frozen=True, eq=False)
class HumanStatistics:
    """Statistics of human motions."""

    mean: np.ndarray
    """(3,) of each criterion"""
    spread: np.ndarray
    """(3,) standard deviations"""
    posture: np.ndarray
    """(k,) mean of the fingers' joints, rad"""
    synergies: np.ndarray
    """(SYNERGIES, k) orthonormal"""


def human_statistics(references: Sequence[HandReference], rate_hz: float) -> HumanStatistics:
    """Measure human motions at `rate_hz`, the rate of the motions to score; ValueError for fewer than two references."""
    if len(references) < 2:
        raise ValueError(f"human likeness: expected two references or more to compare with, got {len(references)}")
    clips = [_clip(one, rate_hz) for one in references]
    joints = np.concatenate([q for q, _ in clips])
    posture = joints.mean(axis=0)
    synergies = np.linalg.svd(joints - posture, full_matrices=False)[2][:SYNERGIES]
    found = np.array([criteria(q, palm, rate_hz, posture, synergies) for q, palm in clips])
    return HumanStatistics(found.mean(axis=0), found.std(axis=0), posture, synergies)


def human_likeness(q: np.ndarray, palm: np.ndarray, rate_hz: float, people: HumanStatistics) -> tuple[float, np.ndarray]:
    """Score finger joints (t, k) and palm positions (t, 3): 0..10, and its three parts (3,) in 0..1."""
    found = criteria(q, palm, rate_hz, people.posture, people.synergies)
    parts = np.exp(-(found - people.mean - people.spread).clip(min=0) / SCALES)
    return float(10 * parts.mean()), parts


def criteria(q: np.ndarray, palm: np.ndarray, rate_hz: float, posture: np.ndarray, synergies: np.ndarray) -> np.ndarray:
    """Compute (3,) detour, log jerk and unexplained share; lower is more human."""
    low = int(palm[:, 2].argmin())
    straight = np.linalg.norm(palm[low] - palm[0]) + np.linalg.norm(palm[-1] - palm[low])
    way = np.linalg.norm(np.diff(palm, axis=0), axis=1).sum()
    detour = np.log(max(way, 1e-6) / max(straight, 1e-6))
    jerk = (log_jerk(palm, rate_hz) + log_jerk(q, rate_hz)) / 2
    centred = q - posture
    left = centred - centred @ synergies.T @ synergies
    return np.array([detour, jerk, (left**2).sum() / max((centred**2).sum(), 1e-12)])


def log_jerk(x: np.ndarray, rate_hz: float) -> float:
    """Compute the log dimensionless jerk of a path (t, d): ln of integrated squared jerk, times duration^3 over squared peak speed.

    4.79 for one minimum-jerk reach; 0 for a path that never moves.
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
