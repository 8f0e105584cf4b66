"""A background with depth, from sightings of its points alone: one projective camera per frame, three numbers per point.

Scene point (x, y, k): x, y of the main plane in the reference frame, and parallax k, how far it lies off that plane. Camera
(3, 4): the homography of the plane beside a column along which parallax moves points ("plane + parallax", Irani & Anandan
1996). No lens needs to be known. Coordinates are unit coordinates, about -1..1 over the image (`unit_matrix`).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit

ROUNDS, FLAT_ROUNDS = 20, 8
FLAT_MISS_PX = 0.7
"""a scene that planes explain to this accuracy (90 % of the sightings) has no depth worth guessing"""
POWER_ROUNDS = 30
HUBER_PX = 0.3
FREE = [0, 1, 3]
"""entries of a point that may move"""
CALM_CAMERA, CALM_POINT = 1e-3, 1e-4
"""weights of the prior that an update is small, per unit^2"""
NEAREST = 1e-4
"""smallest depth to divide by: a point on the horizon of a badly linked frame must not go to infinity"""
RIDGE = 1e-10
"""share of its trace that is added to the diagonal of a system, so that rounding cannot make it singular"""
DOUBT, FLAT = 0.005, 1e3
"""parallax explains noise as well: its products are shrunk by this singular value, unit coordinates"""
MAX_CORNERS = 500
SPACING_PX = 7
QUALITY = 0.003
RETURN_PX = 0.5
"""a corner is kept when following it there and back ends this near to where it began"""
WINDOW = (13, 13)
LEVELS = 3


@dataclass(frozen=True)
class Sightings:
    """n sightings: `point` (n,) int64 which one, `row` (n,) int64 in which frame, `xy` (n, 2) float64 where (px)."""

    point: np.ndarray
    row: np.ndarray
    xy: np.ndarray


def track_points(grey: np.ndarray, static: np.ndarray) -> Sightings:
    """Follow corners from frame to frame where `static` (t, h, w) bool; lost ones are replaced by new points.

    grey: (t, h, w) uint8, neighbours in time. Points seen once only are left out.
    """
    live, ids, found, born = np.zeros((0, 2), np.float32), np.zeros(0, np.int64), [], 0
    for t in range(len(grey)):
        if t > 0:
            live, kept = _follow(grey[t - 1], grey[t], live, static[t])
            ids = ids[kept]
        fresh = _new_corners(grey[t], static[t], live)
        live, ids = np.concatenate([live, fresh]), np.concatenate([ids, np.arange(born, born + len(fresh))])
        born += len(fresh)
        found.append((ids, np.full(len(ids), t), live.astype(np.float64)))
    point, row, xy = (np.concatenate(part) for part in zip(*found, strict=True))
    often = np.bincount(point, minlength=born)[point] > 1
    return Sightings(np.unique(point[often], return_inverse=True)[1], row[often], xy[often])


def _follow(before: np.ndarray, after: np.ndarray, points: np.ndarray, static: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if not len(points):
        return points, np.zeros(0, bool)
    there, _, _ = cv2.calcOpticalFlowPyrLK(before, after, points, None, winSize=WINDOW, maxLevel=LEVELS)
    back, _, _ = cv2.calcOpticalFlowPyrLK(after, before, there, None, winSize=WINDOW, maxLevel=LEVELS)
    x, y = np.rint(there).astype(int).T
    inside = (x >= 0) & (y >= 0) & (x < static.shape[1]) & (y < static.shape[0])
    kept = inside & (np.abs(back - points).max(axis=1) < RETURN_PX)
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
    """(3, 3) from pixels to unit coordinates: origin in the middle, longer side from -1 to 1."""
    scale = 2 / max(width, height)
    return np.array([[scale, 0, -scale * width / 2], [0, scale, -scale * height / 2], [0, 0, 1]])


def reconstruct(seen: Sightings, planes: np.ndarray, unit_px: float) -> tuple[np.ndarray, np.ndarray]:
    """Cameras (t, 3, 4) and points (n, 4) x, y, 1, k that explain the sightings, by alternating least squares.

    seen: sightings in unit coordinates. planes: (t, 3, 3) homographies from the reference to every frame, to begin with.
    unit_px: one pixel in unit coordinates.
    """
    cameras = np.concatenate([planes, np.zeros((len(planes), 3, 1))], axis=2)
    points = _on_plane(seen, planes)
    _alternate(cameras, points, seen, unit_px, FLAT_ROUNDS, FLAT)
    left = miss(cameras, points, seen)
    if np.quantile(np.linalg.norm(left, axis=1), 0.9) > FLAT_MISS_PX * unit_px:
        points[:, 3], cameras[:, :2, 3] = _main_parallax(seen, -left, points, len(planes))
        _alternate(cameras, points, seen, unit_px, ROUNDS, DOUBT)
    return cameras, points


def _alternate(cameras: np.ndarray, points: np.ndarray, seen: Sightings, unit_px: float, rounds: int, doubt: float) -> None:
    for _ in range(rounds):
        _improve_cameras(cameras, points, seen, HUBER_PX * unit_px, doubt)
        _improve_points(cameras, points, seen, HUBER_PX * unit_px, doubt)


def miss(cameras: np.ndarray, points: np.ndarray, seen: Sightings) -> np.ndarray:
    """(m, 2) projected minus seen position of every sighting, in unit coordinates."""
    return _project(cameras, points, seen)[0] - seen.xy


def _project(cameras: np.ndarray, points: np.ndarray, seen: Sightings) -> tuple[np.ndarray, np.ndarray]:
    homogeneous = np.einsum("mij,mj->mi", cameras[seen.row], points[seen.point])
    depth = homogeneous[:, 2:]
    depth = np.copysign(np.maximum(np.abs(depth), NEAREST), depth)
    return homogeneous[:, :2] / depth, depth


def _on_plane(seen: Sightings, planes: np.ndarray) -> np.ndarray:
    """Points (n, 4) with k = 0: the mean of where their sightings lie on the plane."""
    back = np.einsum("mij,mj->mi", np.linalg.inv(planes)[seen.row], np.column_stack([seen.xy, np.ones(len(seen.xy))]))
    times = np.bincount(seen.point)
    points = np.zeros((len(times), 4))
    points[:, 2] = 1
    for axis in range(2):
        points[:, axis] = np.bincount(seen.point, back[:, axis] / back[:, 2]) / times
    return points


def _main_parallax(seen: Sightings, left: np.ndarray, points: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Best rank-1 account of what planes leave (m, 2): parallax (n,) of the points times a push (t, 2) of the frames."""
    liveliest = int(np.argmax(np.bincount(seen.row, (left**2).sum(axis=1), count)))
    there = seen.row == liveliest
    parallax = np.zeros(len(points))
    parallax[seen.point[there]] = left[there] @ np.linalg.svd(left[there], full_matrices=False)[2][0]
    for _ in range(POWER_ROUNDS):
        along = _push(seen, parallax, left, count)[seen.row]
        energy = np.bincount(seen.point, (along**2).sum(axis=1)) + 1e-9
        parallax = np.bincount(seen.point, (left * along).sum(axis=1)) / energy
        parallax = _off_plane(parallax, points)
    push = _push(seen, parallax, left, count)
    balance = np.sqrt(np.linalg.norm(push) / (np.linalg.norm(parallax) + 1e-12))
    return parallax * balance, push / balance


def _push(seen: Sightings, parallax: np.ndarray, left: np.ndarray, count: int) -> np.ndarray:
    """(t, 2): how far each frame moves a point of parallax 1, by least squares."""
    each = parallax[seen.point]
    energy = np.bincount(seen.row, each**2, count) + 1e-12
    return np.stack([np.bincount(seen.row, left[:, axis] * each, count) / energy for axis in range(2)], axis=1)


def _off_plane(parallax: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Take out what a plane explains (the homographies can do that) and scale to at most 1."""
    weight = np.sqrt(1 / (1 + (parallax / (np.median(np.abs(parallax)) + 1e-9)) ** 2))
    plane = np.linalg.lstsq(points[:, :3] * weight[:, None], parallax * weight, rcond=None)[0]
    parallax = parallax - points[:, :3] @ plane
    return parallax / (np.abs(parallax).max() + 1e-12)


def _improve_cameras(cameras: np.ndarray, points: np.ndarray, seen: Sightings, huber: float, doubt: float) -> None:
    at, depth = _project(cameras, points, seen)
    rows = np.zeros((len(at), 2, 12))
    scaled = points[seen.point] / depth
    rows[:, 0, 0:4] = rows[:, 1, 4:8] = scaled
    rows[:, :, 8:] = -at[:, :, None] * scaled[:, None, :]
    held = doubt * np.tile([0, 0, 0, 1.0], 3)
    step = _solve(seen.row, cameras.reshape(-1, 12), rows, at - seen.xy, huber, CALM_CAMERA, held)
    cameras -= step.reshape(-1, 3, 4)


def _improve_points(cameras: np.ndarray, points: np.ndarray, seen: Sightings, huber: float, doubt: float) -> None:
    at, depth = _project(cameras, points, seen)
    mine = cameras[seen.row]
    rows = (mine[:, :2] - at[:, :, None] * mine[:, 2:3]) / depth[:, :, None]
    rows, held = np.ascontiguousarray(rows[:, :, FREE]), doubt * np.array([0, 0, 1.0])
    points[:, FREE] -= _solve(seen.point, points[:, FREE], rows, at - seen.xy, huber, CALM_POINT, held)


def _solve(
    owner: np.ndarray, now: np.ndarray, rows: np.ndarray, left: np.ndarray, huber: float, calm: float, held: np.ndarray
) -> np.ndarray:
    """One robust least-squares step per owner, of the values `now` (n, d), from rows (m, 2, d) and misses (m, 2).

    calm: weight against any step; held: (d,) weights that pull a value towards 0.
    """
    weight = 1 / np.maximum(1, np.linalg.norm(left, axis=1) / huber)
    hessian, gradient = np.tile(np.diag(held + calm), (len(now), 1, 1)), now * held
    _accumulate(owner, rows, left, weight, hessian, gradient)
    hessian += RIDGE * np.trace(hessian, axis1=1, axis2=2)[:, None, None] * np.eye(now.shape[1])
    return np.linalg.solve(hessian, gradient[..., None])[..., 0]


@njit(cache=True)
def _accumulate(
    owner: np.ndarray, rows: np.ndarray, left: np.ndarray, weight: np.ndarray, hessian: np.ndarray, gradient: np.ndarray
) -> None:
    for i in range(rows.shape[0]):
        o = owner[i]
        for r in range(2):
            for a in range(rows.shape[2]):
                value = rows[i, r, a] * weight[i]
                gradient[o, a] += value * left[i, r]
                for b in range(rows.shape[2]):
                    hessian[o, a, b] += value * rows[i, r, b]
