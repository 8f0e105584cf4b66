"""Plane + parallax reconstruction of the background from tracked points (Irani & Anandan 1996), without intrinsics.

Scene point (x, y, k): position x, y on the main plane in the reference frame, and parallax k off that plane. Camera (3, 4): the
homography of the plane, and a column along which parallax moves points. Coordinates are unit coordinates, about -1..1 over the
image (`unit_matrix`).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

ROUNDS, PLANE_ROUNDS = 20, 8
PLANE_ERROR_PX = 0.7
"""a scene that planes explain to this accuracy (90 % of the observations) is reconstructed without depth"""
POWER_ROUNDS = 30
HUBER_PX = 0.3
FREE = [0, 1, 3]
"""free entries of a point"""
CAMERA_DAMPING, POINT_DAMPING = 1e-3, 1e-4
"""weights of the prior that an update is small, per unit^2"""
NEAREST = 1e-4
"""smallest depth to divide by, so that a point on the horizon of a badly registered frame stays finite"""
RIDGE = 1e-10
"""share of the trace that is added to the diagonal of a system, so that rounding cannot make it singular"""
PARALLAX_PRIOR, PLANE_PRIOR = 0.005, 1e3
"""weights of the prior on zero parallax, with depth and for a plane, unit coordinates; parallax would explain noise as well"""
MAX_CORNERS = 500
SPACING_PX = 7
QUALITY = 0.003
MAX_ROUND_TRIP_PX = 0.5
"""largest forward-backward error of a tracked corner"""
WINDOW = (13, 13)
LEVELS = 3


@dataclass(frozen=True)
class Observations:
    """Image positions of tracked points, n observations."""

    point: np.ndarray
    """(n,) int64 index of the point"""
    row: np.ndarray
    """(n,) int64 row of the frame"""
    xy: np.ndarray
    """(n, 2) float64 position, px"""


def track_points(grey: np.ndarray, static: np.ndarray) -> Observations:
    """Track corners (Kanade-Lucas-Tomasi) inside `static` (t, h, w) bool; new corners replace lost ones.

    grey: (t, h, w) uint8, consecutive in time. Points with a single observation are dropped.
    """
    live, ids, found, born = np.zeros((0, 2), np.float32), np.zeros(0, np.int64), [], 0
    for t in range(len(grey)):
        if t > 0:
            live, kept = _track_corners(grey[t - 1], grey[t], live, static[t])
            ids = ids[kept]
        fresh = _new_corners(grey[t], static[t], live)
        live, ids = np.concatenate([live, fresh]), np.concatenate([ids, np.arange(born, born + len(fresh))])
        born += len(fresh)
        found.append((ids, np.full(len(ids), t), live.astype(np.float64)))
    point, row, xy = (np.concatenate(part) for part in zip(*found, strict=True))
    often = np.bincount(point, minlength=born)[point] > 1
    return Observations(np.unique(point[often], return_inverse=True)[1], row[often], xy[often])


def _track_corners(before: np.ndarray, after: np.ndarray, points: np.ndarray, static: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if not len(points):
        return points, np.zeros(0, bool)
    there, _, _ = cv2.calcOpticalFlowPyrLK(before, after, points, None, winSize=WINDOW, maxLevel=LEVELS)
    back, _, _ = cv2.calcOpticalFlowPyrLK(after, before, there, None, winSize=WINDOW, maxLevel=LEVELS)
    x, y = np.rint(there).astype(int).T
    inside = (x >= 0) & (y >= 0) & (x < static.shape[1]) & (y < static.shape[0])
    kept = inside & (np.abs(back - points).max(axis=1) < MAX_ROUND_TRIP_PX)
    kept[kept] &= static[y[kept], x[kept]]
    return there[kept], kept


def _new_corners(grey: np.ndarray, static: np.ndarray, live: np.ndarray) -> np.ndarray:
    free = static.astype(np.uint8) * 255
    for x, y in live:
        cv2.circle(free, (round(float(x)), round(float(y))), SPACING_PX, 0, -1)
    if len(live) >= MAX_CORNERS:
        return np.zeros((0, 2), np.float32)
    corners = cv2.goodFeaturesToTrack(grey, MAX_CORNERS - len(live), QUALITY, SPACING_PX, mask=free)
    return np.zeros((0, 2), np.float32) if corners is None else corners.reshape(-1, 2)


def unit_matrix(width: int, height: int) -> np.ndarray:
    """Matrix (3, 3) from pixels to unit coordinates: origin in the middle, longer side from -1 to 1."""
    scale = 2 / max(width, height)
    return np.array([[scale, 0, -scale * width / 2], [0, scale, -scale * height / 2], [0, 0, 1]])


def reconstruct(seen: Observations, planes: np.ndarray, unit_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Reconstruct cameras (t, 3, 4) and points (n, 4) x, y, 1, k from observations by alternating robust least squares.

    seen: observations in unit coordinates. planes: (t, 3, 3) initial homographies from the reference to every frame.
    unit_px: one pixel in unit coordinates.
    """
    cameras = np.concatenate([planes, np.zeros((len(planes), 3, 1))], axis=2)
    points = _on_plane(seen, planes)
    _alternate(cameras, points, seen, unit_px, PLANE_ROUNDS, PLANE_PRIOR)
    residual = reprojection_error(cameras, points, seen)
    if np.quantile(np.linalg.norm(residual, axis=1), 0.9) > PLANE_ERROR_PX * unit_px:
        points[:, 3], cameras[:, :2, 3] = _main_parallax(seen, -residual, points, len(planes))
        _alternate(cameras, points, seen, unit_px, ROUNDS, PARALLAX_PRIOR)
    return cameras, points


def _alternate(cameras: np.ndarray, points: np.ndarray, seen: Observations, unit_px: float, rounds: int, prior: float) -> None:
    for _ in range(rounds):
        _update_cameras(cameras, points, seen, HUBER_PX * unit_px, prior)
        _update_points(cameras, points, seen, HUBER_PX * unit_px, prior)


def reprojection_error(cameras: np.ndarray, points: np.ndarray, seen: Observations) -> np.ndarray:
    """Reprojection error (m, 2) of every observation: projected minus observed position, in unit coordinates."""
    return _project(cameras, points, seen)[0] - seen.xy


def _project(cameras: np.ndarray, points: np.ndarray, seen: Observations) -> tuple[np.ndarray, np.ndarray]:
    homogeneous = np.einsum("mij,mj->mi", cameras[seen.row], points[seen.point])
    depth = homogeneous[:, 2:]
    depth = np.copysign(np.maximum(np.abs(depth), NEAREST), depth)
    return homogeneous[:, :2] / depth, depth


def _on_plane(seen: Observations, planes: np.ndarray) -> np.ndarray:
    """Initial points (n, 4) with k = 0: the mean of their observations, projected back to the plane."""
    back = np.einsum("mij,mj->mi", np.linalg.inv(planes)[seen.row], np.column_stack([seen.xy, np.ones(len(seen.xy))]))
    times = np.bincount(seen.point)
    points = np.zeros((len(times), 4))
    points[:, 2] = 1
    for axis in range(2):
        points[:, axis] = np.bincount(seen.point, back[:, axis] / back[:, 2]) / times
    return points


def _main_parallax(seen: Observations, residual: np.ndarray, points: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Factorise the residuals of the plane (m, 2) at rank 1: parallax (n,) of points times translations (t, 2) of frames."""
    busiest = int(np.argmax(np.bincount(seen.row, (residual**2).sum(axis=1), count)))
    there = seen.row == busiest
    parallax = np.zeros(len(points))
    parallax[seen.point[there]] = residual[there] @ np.linalg.svd(residual[there], full_matrices=False)[2][0]
    for _ in range(POWER_ROUNDS):
        along = _translations(seen, parallax, residual, count)[seen.row]
        energy = np.bincount(seen.point, (along**2).sum(axis=1)) + 1e-9
        parallax = np.bincount(seen.point, (residual * along).sum(axis=1)) / energy
        parallax = _off_plane(parallax, points)
    translation = _translations(seen, parallax, residual, count)
    balance = np.sqrt(np.linalg.norm(translation) / (np.linalg.norm(parallax) + 1e-12))
    return parallax * balance, translation / balance


def _translations(seen: Observations, parallax: np.ndarray, residual: np.ndarray, count: int) -> np.ndarray:
    """Translation (t, 2) of a point of parallax 1 in each frame, by least squares."""
    each = parallax[seen.point]
    energy = np.bincount(seen.row, each**2, count) + 1e-12
    return np.stack([np.bincount(seen.row, residual[:, axis] * each, count) / energy for axis in range(2)], axis=1)


def _off_plane(parallax: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Remove the component of the parallax that a plane explains, which the homographies cover, and scale to at most 1."""
    weight = np.sqrt(1 / (1 + (parallax / (np.median(np.abs(parallax)) + 1e-9)) ** 2))
    plane = np.linalg.lstsq(points[:, :3] * weight[:, None], parallax * weight, rcond=None)[0]
    parallax = parallax - points[:, :3] @ plane
    return parallax / (np.abs(parallax).max() + 1e-12)


def _update_cameras(cameras: np.ndarray, points: np.ndarray, seen: Observations, huber: float, prior: float) -> None:
    at, depth = _project(cameras, points, seen)
    rows = np.zeros((len(at), 2, 12))
    scaled = points[seen.point] / depth
    rows[:, 0, 0:4] = rows[:, 1, 4:8] = scaled
    rows[:, :, 8:] = -at[:, :, None] * scaled[:, None, :]
    shrinkage = prior * np.tile([0, 0, 0, 1.0], 3)
    step = _solve(seen.row, cameras.reshape(-1, 12), rows, at - seen.xy, huber, CAMERA_DAMPING, shrinkage)
    cameras -= step.reshape(-1, 3, 4)


def _update_points(cameras: np.ndarray, points: np.ndarray, seen: Observations, huber: float, prior: float) -> None:
    at, depth = _project(cameras, points, seen)
    mine = cameras[seen.row]
    rows = (mine[:, :2] - at[:, :, None] * mine[:, 2:3]) / depth[:, :, None]
    rows, shrinkage = np.ascontiguousarray(rows[:, :, FREE]), prior * np.array([0, 0, 1.0])
    points[:, FREE] -= _solve(seen.point, points[:, FREE], rows, at - seen.xy, huber, POINT_DAMPING, shrinkage)


def _solve(
    owner: np.ndarray, now: np.ndarray, rows: np.ndarray, residual: np.ndarray, huber: float, damping: float, shrinkage: np.ndarray
) -> np.ndarray:
    """Solve one robust least-squares step of the values `now` (n, d) of each owner, from rows (m, 2, d) and residuals (m, 2).

    damping: weight of the prior on a small step; shrinkage: (d,) weights of the prior on small values.
    """
    weight = 1 / np.maximum(1, np.linalg.norm(residual, axis=1) / huber)
    hessian, gradient = np.tile(np.diag(shrinkage + damping), (len(now), 1, 1)), now * shrinkage
    _accumulate(owner, rows, residual, weight, hessian, gradient)
    hessian += RIDGE * np.trace(hessian, axis1=1, axis2=2)[:, None, None] * np.eye(now.shape[1])
    return np.linalg.solve(hessian, gradient[..., None])[..., 0]


@njit(cache=True)
def _accumulate(
    owner: np.ndarray, rows: np.ndarray, residual: np.ndarray, weight: np.ndarray, hessian: np.ndarray, gradient: np.ndarray
) -> None:
    for i in range(rows.shape[0]):
        o = owner[i]
        for r in range(2):
            for a in range(rows.shape[2]):
                value = rows[i, r, a] * weight[i]
                gradient[o, a] += value * residual[i, r]
                for b in range(rows.shape[2]):
                    hessian[o, a, b] += value * rows[i, r, b]
