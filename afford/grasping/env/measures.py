"""What rewards and judgements go by: distances, forces, depths, of n worlds at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from afford.grasping.env.scenery import Episode, Scenery
from afford.grasping.sim.engine import State

TOUCH_N = 0.01
"""force from which something touches"""
FAR_M = 10.0
"""where points are put, along all axes, that do not count"""


@dataclass(frozen=True, eq=False)
class Measures:
    """One moment of n worlds; f fingers, thumb first."""

    palm_m: np.ndarray
    """(n,) from the middle of the palm to the object's centre of mass"""
    tips_m: np.ndarray
    """(n, f) from each fingertip to the nearest point of the object's surface"""
    allowed_m: np.ndarray
    """(n, f) from each fingertip to the nearest of the points that may be touched, farther than 2 cm from all negative ones"""
    positive_m: np.ndarray
    """(n, f) from each fingertip to the nearest point where hands belong; 0 where none are known"""
    tips_centre_m: np.ndarray
    """(n, f) from each fingertip to the object's centre of mass"""
    goal_m: np.ndarray
    """(n,) from the object's centre of mass to its goal"""
    height_m: np.ndarray
    """(n,) of the object's centre of mass above the table"""
    N_m: np.ndarray
    """(n, f) from each fingertip to the nearest negative point that is shown; infinite where there are none"""
    N_true_m: np.ndarray
    """(n, f) the same of what must not be touched in truth"""
    force_held: np.ndarray
    """(n, f + 1) N that each finger, and last the rest of the hand, press on parts that may be touched with"""
    force_negative: np.ndarray
    """(n, f + 1) N on negative parts, in truth"""
    force_told: np.ndarray
    """(n, f + 1) N on parts that N_t says are negative"""
    penetration_m: np.ndarray
    """(n,) of the deepest contact of hand and object"""
    away_m: np.ndarray
    """(n,) how far the object's centre of mass is, along the table, from where it lay"""
    action: np.ndarray
    """(n, m) that led here"""

    @property
    def touching(self) -> np.ndarray:
        """(n, f + 1) bool: finger or palm on the object."""
        found: np.ndarray = self.force_held + self.force_negative > TOUCH_N
        return found

    @property
    def gripped(self) -> np.ndarray:
        """(n,) bool: two or more of the fingers and the palm press on the object."""
        found: np.ndarray = self.touching.sum(axis=1) >= 2
        return found


def measure(scenery: Scenery, episode: Episode, state: State, action: np.ndarray) -> Measures:
    """All of them, now."""
    centre = scenery.centre(state)
    points = scenery.points(state)
    on_N = np.einsum("nfp,np->nf", state.force, scenery.negative.astype(float))
    return Measures(
        palm_m=np.linalg.norm(scenery.palm(state) - centre, axis=1),
        tips_m=nearest(state.tips, points)[0],
        allowed_m=nearest(state.tips, np.where(scenery.allowed[:, :, None], points, FAR_M))[0],
        positive_m=scenery.any_positive[:, None] * nearest(state.tips, scenery.positive_points(state))[0],
        tips_centre_m=np.linalg.norm(state.tips - centre[:, None], axis=2),
        goal_m=np.linalg.norm(centre - episode.goal, axis=1),
        height_m=centre[:, 2],
        N_m=_to(state.tips, scenery.negative_points(state), scenery.any_negative),
        N_true_m=_to(state.tips, scenery.true_points(state), scenery.any_true),
        force_held=state.force.sum(axis=2) - on_N, force_negative=on_N,
        force_told=np.einsum("nfp,np->nf", state.force, scenery.told.astype(float)), penetration_m=np.asarray(state.penetration_m),
        away_m=np.linalg.norm((centre - episode.origin)[:, :2], axis=1), action=action)  # fmt: skip


def nearest(spots: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each of (n, f, 3) the distance to the nearest of (n, k, 3): (n, f), and that point: (n, f, 3)."""
    squared = (spots**2).sum(2)[:, :, None] + (points**2).sum(2)[:, None] - 2 * spots @ points.swapaxes(1, 2)
    chosen = squared.argmin(axis=2)
    found = np.take_along_axis(points, chosen[:, :, None], axis=1)
    return np.linalg.norm(spots - found, axis=2), found


def _to(spots: np.ndarray, points: np.ndarray, there: np.ndarray) -> np.ndarray:
    """(n, f) distances of spots to points, infinite where there are none."""
    return np.where(there[:, None], nearest(spots, points)[0], np.inf)
