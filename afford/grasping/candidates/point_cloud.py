"""Point cloud of a depth image, the plane that supports the object, and the points of the object.

The depth image is unprojected and downsampled to voxels, with normals and the values of the masks. Nothing is random.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from afford.common.geometry import farthest_point_sampling
from schemas.grasp import GraspScene

NEIGHBOURS = 16
"""points to which a normal is fitted"""
LONELY = 4.0
"""a point whose fourth neighbour is farther than this many voxels is an outlier between two surfaces"""


@dataclass(frozen=True, eq=False)
class PointCloud:
    """n points in the camera frame, metres."""

    points: np.ndarray
    """(n, 3)"""
    normals: np.ndarray
    """(n, 3) unit, towards the camera"""
    region: np.ndarray
    """(2, n) share of each point's pixels in the region of the (left, right) hand"""
    negative: np.ndarray
    """(n,) share of its pixels that no hand may touch"""
    rgb: np.ndarray
    """(n, 3) uint8"""

    def cut(self, keep: np.ndarray) -> PointCloud:
        """Return the points of a mask (n,)."""
        return PointCloud(self.points[keep], self.normals[keep], self.region[:, keep], self.negative[keep], self.rgb[keep])


def unproject(depth_m: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Unproject depths (h, w) to points (h, w, 3) in the camera frame, metres; pixel centres are whole numbers."""
    y, x = np.indices(depth_m.shape, dtype=np.float64)
    down = (y - K[1, 2]) / K[1, 1]
    rays = np.stack([(x - K[0, 2] - K[0, 1] * down) / K[0, 0], down, np.ones_like(x)], axis=-1)
    found: np.ndarray = rays * depth_m[..., None]
    return found


def point_cloud(scene: GraspScene, cell_m: float, around_m: float) -> PointCloud:
    """Build the cloud within `around_m` of any region, one point per voxel of `cell_m`.

    ValueError when no region has depth.
    """
    points, seen = unproject(scene.depth_m, scene.K), scene.depth_m > 0
    wanted = (scene.region & scene.hands[:, None, None]).any(0)
    core = points[wanted & seen]
    if not len(core):
        sides = " and ".join(side for side, used in zip(("left", "right"), scene.hands, strict=True) if used) or "either"
        got = f"{int(wanted.sum())} pixels without depth" if wanted.any() else "an empty mask"
        raise ValueError(f"{scene.name}: expected a region with depth for the {sides} hand, got {got}; check masks, depth and "
                         "hands")  # fmt: skip
    low, high = core.min(0) - around_m, core.max(0) + around_m
    near = seen & ((points >= low) & (points <= high)).all(-1)
    values = np.concatenate([points[near], scene.region[:, near].T, scene.negative[near][:, None], scene.rgb[near]], axis=1)
    return _without_outliers(voxel_downsample(points[near], values, cell_m), cell_m)


def voxel_downsample(points: np.ndarray, values: np.ndarray, cell_m: float) -> np.ndarray:
    """Average the values (n, k) of the points (n, 3) in each voxel of a grid: (c, k)."""
    _, cell = np.unique(np.floor(points / cell_m).astype(np.int64), axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    count = np.bincount(cell)
    return np.stack([np.bincount(cell, column) / count for column in values.T], axis=1)


def estimate_normals(points: np.ndarray, neighbours: int = NEIGHBOURS) -> np.ndarray:
    """Estimate unit normals (n, 3) from planes through each point's neighbours, oriented towards the origin."""
    _, near = cKDTree(points).query(points, k=min(neighbours, len(points)))
    local = points[near.reshape(len(points), -1)]
    local = local - local.mean(1, keepdims=True)
    found: np.ndarray = np.linalg.eigh(np.einsum("nki,nkj->nij", local, local))[1][:, :, 0]
    return np.where((found * points).sum(1, keepdims=True) > 0, -found, found)


def _without_outliers(rows: np.ndarray, cell_m: float) -> PointCloud:
    """Remove outliers."""
    if len(rows) > 4:
        rows = rows[cKDTree(rows[:, :3]).query(rows[:, :3], k=5)[0][:, 4] <= LONELY * cell_m]
    if len(rows) < NEIGHBOURS:
        raise ValueError(f"expected a region and its surroundings of {NEIGHBOURS} points or more {1000 * cell_m:g} mm apart, got "
                         f"{len(rows)}; check that depth is in metres, or make cell_m smaller")
    points = rows[:, :3]
    return PointCloud(points, estimate_normals(points), rows[:, 3:5].T, rows[:, 5], np.rint(rows[:, 6:9]).astype(np.uint8))


PROPOSALS = 64
"""points, far apart, each of which proposes the plane through it with its own normal"""
NEAR_M = 0.006
"""distance up to which a point is an inlier of a plane"""
LEAST_SHARE = 0.2
"""share of all points that the support plane must contain"""
WIDE_M = 0.03
"""standard deviation of the inliers along their narrower side, at least; rules out narrow strips of an object"""
LIFT_M = 0.006
"""points higher above the plane belong to objects on it"""
APART_M = 0.012
"""points farther apart belong to different objects"""
MINE = 0.1
"""a component that contains this share of a region belongs to its object"""


@dataclass(frozen=True, eq=False)
class SupportPlane:
    """Plane normal @ x = offset, with its normal towards the camera.

    When there is none, `up` is zero and every height is infinite.
    """

    up: np.ndarray
    offset_m: float

    @property
    def known(self) -> bool:
        """True when a plane was found."""
        return bool(self.up.any())

    def height(self, points: np.ndarray) -> np.ndarray:
        """Return the (...,) height of points (..., 3) above the plane, metres; infinite without a plane."""
        return points @ self.up - self.offset_m if self.known else np.full(points.shape[:-1], np.inf)


NONE = SupportPlane(np.zeros(3), 0.0)


def support_plane(found: PointCloud) -> SupportPlane:
    """Find the plane that contains most points outside all regions, if it contains enough."""
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
    """Return (n,) bool: the points of the object of which the region (n,) bool is a part.

    They are the region and the connected components above the support that contain some of it.
    """
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
    """Return the standard deviation along the second principal axis."""
    local = points - points.mean(0)
    return float(np.sqrt(np.linalg.eigvalsh(local.T @ local / len(points))[1]))


def _through(points: np.ndarray) -> SupportPlane:
    """Fit a plane to points by least squares."""
    middle = points.mean(0)
    local = points - middle
    up = np.linalg.eigh(local.T @ local)[1][:, 0]
    up = -up if up @ middle > 0 else up
    return SupportPlane(up, float(up @ middle))
