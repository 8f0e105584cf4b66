"""A picture with depth as points: unprojected, thinned to a grid of cells, with normals and what the masks say of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from schemas.grasp import GraspScene

NEIGHBOURS = 16
"""that a normal is fitted to"""
LONELY = 4.0
"""a point whose fourth neighbour is farther than this many cells hangs in the air between two things"""


@dataclass(frozen=True, eq=False)
class Cloud:
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

    def cut(self, keep: np.ndarray) -> Cloud:
        """The points of a mask (n,)."""
        return Cloud(self.points[keep], self.normals[keep], self.region[:, keep], self.negative[keep], self.rgb[keep])


def unproject(depth_m: np.ndarray, K: np.ndarray) -> np.ndarray:
    """(h, w, 3) metres in the camera's frame of depths (h, w); pixel centres are whole numbers."""
    y, x = np.indices(depth_m.shape, dtype=np.float64)
    down = (y - K[1, 2]) / K[1, 1]
    rays = np.stack([(x - K[0, 2] - K[0, 1] * down) / K[0, 0], down, np.ones_like(x)], axis=-1)
    found: np.ndarray = rays * depth_m[..., None]
    return found


def cloud(scene: GraspScene, cell_m: float, around_m: float) -> Cloud:
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
    return _solid(thinned(points[near], values, cell_m), cell_m)


def thinned(points: np.ndarray, values: np.ndarray, cell_m: float) -> np.ndarray:
    """(c, k) mean of the values (n, k) of the points (n, 3) in each cell of a grid."""
    _, cell = np.unique(np.floor(points / cell_m).astype(np.int64), axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    count = np.bincount(cell)
    return np.stack([np.bincount(cell, column) / count for column in values.T], axis=1)


def normals(points: np.ndarray, neighbours: int = NEIGHBOURS) -> np.ndarray:
    """(n, 3) unit normals of the planes through each point's neighbours, towards the origin."""
    _, near = cKDTree(points).query(points, k=min(neighbours, len(points)))
    local = points[near.reshape(len(points), -1)]
    local = local - local.mean(1, keepdims=True)
    found: np.ndarray = np.linalg.eigh(np.einsum("nki,nkj->nij", local, local))[1][:, :, 0]
    return np.where((found * points).sum(1, keepdims=True) > 0, -found, found)


def _solid(rows: np.ndarray, cell_m: float) -> Cloud:
    """Without points that hang in the air."""
    if len(rows) > 4:
        rows = rows[cKDTree(rows[:, :3]).query(rows[:, :3], k=5)[0][:, 4] <= LONELY * cell_m]
    if len(rows) < NEIGHBOURS:
        raise ValueError(f"expected a region and its surroundings of {NEIGHBOURS} points or more {1000 * cell_m:g} mm apart, got "
                         f"{len(rows)}; check that depth is in metres, or make cell_m smaller")
    points = rows[:, :3]
    return Cloud(points, normals(points), rows[:, 3:5].T, rows[:, 5], np.rint(rows[:, 6:9]).astype(np.uint8))
