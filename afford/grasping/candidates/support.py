"""What a thing lies on, and which points are the thing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from afford.common.geometry import farthest_point_sampling
from afford.grasping.candidates.cloud import Cloud

PROPOSALS = 64
"""places, far apart, each of which proposes the plane of its own normal: nothing is drawn by chance"""
NEAR_M = 0.006
"""points this near to a plane lie in it"""
LEAST_SHARE = 0.2
"""of all points, that what a thing lies on must have"""
WIDE_M = 0.03
"""standard deviation of its points along its narrower side, at least: no strip of a thing that hangs in the air"""
LIFT_M = 0.006
"""points higher above it belong to what lies on it"""
APART_M = 0.012
"""points farther apart belong to different things"""
MINE = 0.1
"""a piece that holds so much of a region belongs to its thing"""


@dataclass(frozen=True, eq=False)
class Support:
    """A plane: normal @ x = offset, its normal towards the camera. Without one `up` is zero, and everything is far above it."""

    up: np.ndarray
    offset_m: float

    @property
    def known(self) -> bool:
        """Whether there is one."""
        return bool(self.up.any())

    def height(self, points: np.ndarray) -> np.ndarray:
        """(...,) metres above it of points (..., 3); infinite without one."""
        return points @ self.up - self.offset_m if self.known else np.full(points.shape[:-1], np.inf)


NONE = Support(np.zeros(3), 0.0)


def support(found: Cloud) -> Support:
    """The plane that holds most of what is in no region, if it holds enough."""
    rest = np.flatnonzero((found.region.max(0) < 0.5) & (found.negative < 0.5))
    spots = rest[farthest_point_sampling(found.points[rest], PROPOSALS)]
    if not len(spots):
        return NONE
    n, p = found.normals[spots], found.points[spots]
    near = np.abs(found.points @ n.T - (n * p).sum(1)) < NEAR_M
    best = near[:, near.sum(0).argmax()]
    for _ in range(3):
        plane = _through(found.points[best])
        best = np.abs(plane.height(found.points)) < NEAR_M
    return plane if best.mean() >= LEAST_SHARE and _narrow(found.points[best]) >= WIDE_M else NONE


def thing(found: Cloud, region: np.ndarray, on: Support) -> np.ndarray:
    """(n,) bool: the points of what the region (n,) bool is a part of: pieces above the support that hold some of it, and it."""
    high = np.flatnonzero(on.height(found.points) > LIFT_M)
    if not len(high):
        return region
    a, b = cKDTree(found.points[high]).query_pairs(APART_M, output_type="ndarray").T
    piece = connected_components(coo_array((np.ones(len(a), bool), (a, b)), shape=(len(high),) * 2), directed=False)[1]
    held = np.bincount(piece, region[high])
    mine = np.zeros(len(region), bool)
    mine[high[(held >= MINE * max(float(region.sum()), 1.0))[piece]]] = True
    return mine | region


def _narrow(points: np.ndarray) -> float:
    """Standard deviation along the second axis."""
    local = points - points.mean(0)
    return float(np.sqrt(np.linalg.eigvalsh(local.T @ local / len(points))[1]))


def _through(points: np.ndarray) -> Support:
    """The plane nearest to points."""
    middle = points.mean(0)
    local = points - middle
    up = np.linalg.eigh(local.T @ local)[1][:, 0]
    up = -up if up @ middle > 0 else up
    return Support(up, float(up @ middle))
