"""A picture with depth as points: unprojected, thinned to a grid of cells, with normals and what the masks say of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from afford.common.geometry import farthest_point_sampling
from schemas.grasp import GraspScene

NEIGHBOURS = 16
"""that a normal is fitted to"""
LONELY = 4.0
"""a point whose fourth neighbour is farther than this many cells hangs in the air between two things"""


@dataclass(frozen=True, eq=False)
class PointCloud:
    """n points as the camera sees them (camera frame, metres)."""

    points: np.ndarray
    """(n, 3)"""
    normals: np.ndarray
    """(n, 3) unit, towards the camera"""
    region: np.ndarray
    """(2, n) share of each point's pixels where the (left, right) hand belongs"""
    negative: np.ndarray
    """(n,) share that no hand may touch"""
    rgb: np.ndarray
    """(n, 3) uint8"""

    def cut(self, keep: np.ndarray) -> PointCloud:
        """The points of a mask (n,)."""
        return PointCloud(self.points[keep], self.normals[keep], self.region[:, keep], self.negative[keep], self.rgb[keep])


def unproject(depth_m: np.ndarray, K: np.ndarray) -> np.ndarray:
    """(h, w, 3) metres in the camera's frame of depths (h, w); pixel centres are whole numbers."""
    y, x = np.indices(depth_m.shape, dtype=np.float64)
    down = (y - K[1, 2]) / K[1, 1]
    rays = np.stack([(x - K[0, 2] - K[0, 1] * down) / K[0, 0], down, np.ones_like(x)], axis=-1)
    found: np.ndarray = rays * depth_m[..., None]
    return found


def point_cloud(scene: GraspScene, cell_m: float, around_m: float) -> PointCloud:
    """The cloud within `around_m` of any region, a point for each cell of `cell_m`. ValueError when no region has depth."""
    points, seen = unproject(scene.depth_m, scene.K), scene.depth_m > 0
    wanted = (scene.region & scene.hands[:, None, None]).any(0)
    core = points[wanted & seen]
    if not len(core):
        sides = " and ".join(side for side, used in zip(("left", "right"), scene.hands, strict=True) if used) or "either"
        got = f"{int(wanted.sum())} pixels of which none has depth" if wanted.any() else "an empty mask"
        raise ValueError(f"{scene.name}: expected a region with depth for the {sides} hand, got {got}; check masks, depth and "
                         "hands")  # fmt: skip
    low, high = core.min(0) - around_m, core.max(0) + around_m
    near = seen & ((points >= low) & (points <= high)).all(-1)
    values = np.concatenate([points[near], scene.region[:, near].T, scene.negative[near][:, None], scene.rgb[near]], axis=1)
    return _solid(voxel_downsample(points[near], values, cell_m), cell_m)


def voxel_downsample(points: np.ndarray, values: np.ndarray, cell_m: float) -> np.ndarray:
    """(c, k) mean of the values (n, k) of the points (n, 3) in each cell of a grid."""
    _, cell = np.unique(np.floor(points / cell_m).astype(np.int64), axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    count = np.bincount(cell)
    return np.stack([np.bincount(cell, column) / count for column in values.T], axis=1)


def estimate_normals(points: np.ndarray, neighbours: int = NEIGHBOURS) -> np.ndarray:
    """(n, 3) unit normals of the planes through each point's neighbours, towards the origin."""
    _, near = cKDTree(points).query(points, k=min(neighbours, len(points)))
    local = points[near.reshape(len(points), -1)]
    local = local - local.mean(1, keepdims=True)
    found: np.ndarray = np.linalg.eigh(np.einsum("nki,nkj->nij", local, local))[1][:, :, 0]
    return np.where((found * points).sum(1, keepdims=True) > 0, -found, found)


def _solid(rows: np.ndarray, cell_m: float) -> PointCloud:
    """Without points that hang in the air."""
    if len(rows) > 4:
        rows = rows[cKDTree(rows[:, :3]).query(rows[:, :3], k=5)[0][:, 4] <= LONELY * cell_m]
    if len(rows) < NEIGHBOURS:
        raise ValueError(f"expected a region and its surroundings of {NEIGHBOURS} points or more {1000 * cell_m:g} mm apart, got "
                         f"{len(rows)}; check that depth is in metres, or make cell_m smaller")
    points = rows[:, :3]
    return PointCloud(points, estimate_normals(points), rows[:, 3:5].T, rows[:, 5], np.rint(rows[:, 6:9]).astype(np.uint8))


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
class SupportPlane:
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


NONE = SupportPlane(np.zeros(3), 0.0)


def support_plane(found: PointCloud) -> SupportPlane:
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


def object_points(found: PointCloud, region: np.ndarray, on: SupportPlane) -> np.ndarray:
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


def _through(points: np.ndarray) -> SupportPlane:
    """The plane nearest to points."""
    middle = points.mean(0)
    local = points - middle
    up = np.linalg.eigh(local.T @ local)[1][:, 0]
    up = -up if up @ middle > 0 else up
    return SupportPlane(up, float(up @ middle))
