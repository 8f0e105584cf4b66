"""A moment of n grasps, and the blocks of numbers that observations cut from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from afford.grasping.env.measures import Measures
from afford.grasping.env.scenery import Episode, Scenery, palm_yaw, to_frame
from afford.grasping.sim.engine import State


@dataclass(frozen=True, eq=False)
class Now:
    """A moment of n worlds, as blocks are cut from it."""

    scenery: Scenery
    episode: Episode
    state: State
    measures: Measures
    action: np.ndarray
    """(n, m) the last"""
    offset: np.ndarray
    """(n, m) how far actions have moved targets, in full actions"""
    lag: np.ndarray
    """(n, m) how far targets are from the joints, in full actions"""
    phase: np.ndarray
    """(n,) share of the episode that is over"""

    def spot(self, points: np.ndarray, yaw: np.ndarray) -> np.ndarray:
        """(n, ..., 3) places of the world, from the episode's origin, along axes turned by yaw (n,)."""
        origin = self.episode.origin.reshape(-1, *[1] * (points.ndim - 2), 3)
        return to_frame(points - origin, yaw)

    @property
    def palm_yaw(self) -> np.ndarray:
        """(n,) see scenery.palm_yaw."""
        return palm_yaw(self.scenery.hand, self.state)


@dataclass(frozen=True)
class Block:
    """Some numbers of an observation."""

    name: str
    width: int
    doc: str
    cut: Callable[[Now], np.ndarray]
    """-> (n, ...) of `width` numbers each"""


def columns(quaternion: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """(n, 4) -> (n, 6): the first two columns of the rotation, along axes turned by yaw."""
    R = Rotation.from_quat(quaternion).as_matrix()
    return to_frame(R.swapaxes(1, 2)[:, :2], yaw).reshape(len(R), 6)


def spread(points: np.ndarray, chosen: np.ndarray, origin: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """(n, 6): mean, from `origin` (n, 3), and standard deviation of the chosen (n, k) of points (n, k, 3); 0 where none is."""
    weight = chosen / np.maximum(chosen.sum(1, keepdims=True), 1)
    local = to_frame(points - origin[:, None], yaw)
    mean = np.einsum("nk,nki->ni", weight, local)
    around = np.einsum("nk,nki->ni", weight, (local - mean[:, None]) ** 2)
    return np.concatenate([mean, np.sqrt(around)], axis=1)
