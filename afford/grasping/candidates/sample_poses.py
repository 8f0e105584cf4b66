"""Sample grasp poses over a region: fingers across its narrow side, from the camera's side, above the support plane.

The frame of a pose is that of a grasp (schemas/grasp.py). Places are chosen by farthest point sampling and turns come in pairs, so
a mirrored image gives mirrored poses. Nothing is random.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from afford.common.geometry import farthest_point_sampling
from afford.grasping.candidates.point_cloud import PointCloud, SupportPlane

PATCH_M = 0.03
"""radius of the patch around a place that gives its long axis and normal"""
TILTS_DEG, TURNS_DEG = (0.0, -25.0, 25.0), (0.0, -20.0, 20.0)
"""about the long axis; and about the approach, for patches without a clearly longer side"""
LONG = 1.6
"""a patch this many times as long as wide is grasped across its length"""
HALF_SLICE_M = 0.012
"""half the thickness, along the long axis, of the section that the fingers close on"""
GAP_M = 0.012
"""a section ends at a gap of this size"""
DEEP_M = 0.05
"""a section is examined to this depth below its upper end"""
LYING = 2.0
"""a section whose upper end is at most this many times its width above the support lies on it"""
EDGE = 0.25
"""share of a section, at each of its ends, that fingers touch"""


@dataclass(frozen=True, eq=False)
class GraspPose:
    """Grasp before scoring."""

    R: np.ndarray
    """(3, 3) its axes: along, back, fingers"""
    place: np.ndarray
    """(3,) centre of the grasped section"""
    width_m: float
    square: float
    """-1..1, how well the normals at both ends of the section face the fingers; 0 for an end that is not visible"""


def spread_places(region: np.ndarray, found: PointCloud, count: int) -> np.ndarray:
    """Choose (k,) indices of points of the region (n,) bool by farthest point sampling."""
    mine = np.flatnonzero(region)
    return mine[farthest_point_sampling(found.points[mine], count)]


def sample_poses(found: PointCloud, body: np.ndarray, spots: np.ndarray, on: SupportPlane, lean_deg: float,
          cell_m: float) -> list[GraspPose]:  # fmt: skip
    """Sample poses of a hand over each spot (k,); `body` (n,) bool marks the points of the object.

    Each pose comes twice, with the fingers on either side. A point stands for a voxel of `cell_m`.
    """
    points, facing = found.points[body], found.normals[body]
    around = cKDTree(points).query_ball_point(found.points[spots], PATCH_M)
    out: list[GraspPose] = []
    for spot, near in zip(spots, around, strict=True):
        if len(near) < 4:
            continue
        for R in _axes(points[near], facing[near], found.points[spot], on, lean_deg):
            out += _posed(R, found.points[spot], points, facing, on, cell_m)
    return out


def _axes(patch: np.ndarray, facing: np.ndarray, spot: np.ndarray, on: SupportPlane, lean_deg: float) -> Iterator[np.ndarray]:
    """Yield candidate axes (3, 3) over a patch (k, 3)."""
    local = patch - patch.mean(0)
    spread, axes = np.linalg.eigh(local.T @ local)
    long, turns = axes[:, 2], (0.0,) if spread[2] > LONG**2 * spread[1] else TURNS_DEG
    outwards = facing.mean(0) / max(float(np.linalg.norm(facing.mean(0))), 1e-9)
    for back in (outwards, on.up) if on.known else (outwards,):
        for tilt in TILTS_DEG:
            leant = Rotation.from_rotvec(np.radians(tilt) * long).apply(back)
            if leant @ spot >= 0 or (on.known and leant @ on.up < np.cos(np.radians(lean_deg))):
                continue
            for turn in turns:
                yield _frame(Rotation.from_rotvec(np.radians(turn) * leant).apply(long), leant)


def _frame(along: np.ndarray, back: np.ndarray) -> np.ndarray:
    x = along - back * (along @ back)
    x /= max(float(np.linalg.norm(x)), 1e-9)
    return np.stack([x, back, np.cross(x, back)], axis=1)


def _posed(R: np.ndarray, spot: np.ndarray, points: np.ndarray, facing: np.ndarray, on: SupportPlane,
           cell_m: float) -> list[GraspPose]:  # fmt: skip
    """Build the pose at the section under a spot, and the same pose with the fingers on the other side.

    Empty without a section.
    """
    local = (points - spot) @ R
    across = np.flatnonzero((np.abs(local[:, 0]) <= HALF_SLICE_M) & (np.abs(local[:, 1]) <= DEEP_M))
    run = across[_run(local[across, 2])]
    if len(run) < 3:
        return []
    low, high = local[run, 2].min(), local[run, 2].max()
    width, top = float(high - low) + cell_m, float(np.quantile(local[run, 1], 0.9))
    place = spot + R @ np.array([0.0, top - _thick(width, float(on.height(spot + top * R[:, 1]))) / 2, (low + high) / 2])
    square = _square(local[run, 2], facing[run] @ R[:, 2])
    other = R * np.array([-1.0, 1.0, -1.0])
    return [GraspPose(R, place, width, square), GraspPose(other, place, width, square)]


def _thick(width_m: float, height_m: float) -> float:
    """Return the depth of a section: down to its support when it is about as high as wide, else as deep as wide."""
    return min(max(height_m, 0.0) if height_m <= LYING * width_m else width_m, DEEP_M)


def _run(z: np.ndarray) -> np.ndarray:
    """Return the places along a line (k,) that are connected to the one nearest to 0."""
    order = np.argsort(z, kind="stable")
    piece = np.concatenate([[0], np.cumsum(np.diff(z[order]) > GAP_M)]) if len(z) else np.zeros(0, np.int64)
    at = piece[np.abs(z[order]).argmin()] if len(z) else 0
    return order[piece == at]


def _square(z: np.ndarray, outwards: np.ndarray) -> float:
    """Return the mean over both ends of how well normals face outwards."""
    low, high = np.quantile(z, [EDGE, 1 - EDGE])
    return 0.5 * float(outwards[z >= high].mean() - outwards[z <= low].mean())
