"""Registration of the background: cameras of all frames, and the scene point behind a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from afford.extraction.layers.appearance import harmonic_fill
from afford.extraction.layers.parallax import Observations, reconstruct, reprojection_error, track_points, unit_matrix

NEAR_FRAMES = 4
"""frames further apart than this are matched by descriptors instead of tracked corners"""
GROUP_FRAMES = 300
RANSAC_PX = 1.5
MIN_MATCHES = 12
MIN_DEPTH_FRAMES = 6
"""a shorter group is modelled as a plane"""
MIN_OBSERVATIONS, MAX_ERROR_PX = 4, 1.5
"""least observations, and largest mean reprojection error, of a point with reliable parallax"""


@dataclass(frozen=True)
class Background:
    """Registered frames. Frames of the same group share scene coordinates."""

    cameras: np.ndarray
    """(t, 3, 4) float64, scene point x, y, 1, k to homogeneous pixel"""
    group: np.ndarray
    """(t,) int64; frames that could not be registered to each other have different groups"""
    points: np.ndarray
    """(n, 4) float64 scene points with reliable parallax"""
    point_group: np.ndarray
    """(n,) group of each point"""

    def scene_points(self, t: int, pixels: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
        """Compute the scene points (m, 4) behind pixels (m, 2) x, y of frame `t`, with interpolated parallax."""
        parallax = self._parallax(t, shape)[pixels[:, 1], pixels[:, 0]]
        camera = self.cameras[t]
        shift = np.column_stack([pixels, np.ones(len(pixels))])[:, :, None]
        # camera[:, :3] (x, y, 1) + k camera[:, 3] = depth * pixel: linear in x, y and depth
        system = np.concatenate([np.broadcast_to(camera[:, :2], (len(pixels), 3, 2)), -shift], axis=2)
        found = np.linalg.solve(system, -(camera[:, 2] + parallax[:, None] * camera[:, 3])[:, :, None])[:, :2, 0]
        return np.column_stack([found, np.ones(len(pixels)), parallax])

    def _parallax(self, t: int, shape: tuple[int, int]) -> np.ndarray:
        points = self.points[self.point_group == self.group[t]]
        if not len(points):
            return np.zeros(shape, np.float32)
        seen = points @ self.cameras[t].T
        x, y = np.rint(seen[:, :2] / np.where(seen[:, 2:] > 1e-6, seen[:, 2:], np.inf)).astype(int).T
        inside = (seen[:, 2] > 1e-6) & (x >= 0) & (y >= 0) & (x < shape[1]) & (y < shape[0])
        at = y[inside] * shape[1] + x[inside]
        count = np.bincount(at, minlength=shape[0] * shape[1]).reshape(shape)
        total = np.bincount(at, points[inside, 3], shape[0] * shape[1]).reshape(shape)
        return harmonic_fill(total / np.maximum(count, 1), count > 0)


def register(grey: np.ndarray, frame: np.ndarray, static: np.ndarray) -> Background:
    """Register all frames by their static pixels.

    grey: (t, h, w) uint8; frame: (t,) frame numbers; static: (t, h, w) bool, pixels that belong to the background.
    """
    seen = track_points(grey, static)
    links = [None, *(_link(grey, frame, static, seen, t) for t in range(1, len(grey)))]
    group = _groups(links)
    cameras, points, owners = np.zeros((len(grey), 3, 4)), [np.zeros((0, 4))], [np.zeros(0, np.int64)]
    for number in range(int(group.max(initial=-1)) + 1):
        rows = np.flatnonzero(group == number)
        cameras[rows], found = _register_group(links, rows, seen, grey.shape[2], grey.shape[1])
        points.append(found)
        owners.append(np.full(len(found), number))
    return Background(cameras, group, np.concatenate(points), np.concatenate(owners))


def _groups(links: list[np.ndarray | None]) -> np.ndarray:
    """Group number (t,) of every frame: a new group where the link is missing or the group is full."""
    group, size = np.zeros(len(links), np.int64), 1
    for t in range(1, len(links)):
        size = 1 if links[t] is None or size >= GROUP_FRAMES else size + 1
        group[t] = group[t - 1] + (size == 1)
    return group


def _link(grey: np.ndarray, frame: np.ndarray, static: np.ndarray, seen: Observations, t: int) -> np.ndarray | None:
    """Homography (3, 3) from frame t - 1 to frame t, None when too few corners agree."""
    if frame[t] - frame[t - 1] > NEAR_FRAMES:
        return far_homography(grey[t - 1], grey[t], static[t - 1], static[t])
    before, after = seen.row == t - 1, seen.row == t
    _, at_before, at_after = np.intersect1d(seen.point[before], seen.point[after], assume_unique=True, return_indices=True)
    return _homography(seen.xy[before][at_before], seen.xy[after][at_after], RANSAC_PX)


def _homography(before: np.ndarray, after: np.ndarray, threshold_px: float) -> np.ndarray | None:
    if len(before) < MIN_MATCHES:
        return None
    found, agreeing = cv2.findHomography(before, after, cv2.RANSAC, threshold_px)
    return found if found is not None and agreeing.sum() >= MIN_MATCHES else None


def _register_group(
    links: list[np.ndarray | None], rows: np.ndarray, seen: Observations, width: int, height: int
) -> tuple[np.ndarray, np.ndarray]:
    """Cameras (len(rows), 3, 4) to pixels, and the scene points (n, 4) with reliable parallax."""
    planes, unit = [np.eye(3)], unit_matrix(width, height)
    for t in rows[1:]:
        planes.append(links[t] @ planes[-1])
    scaled = unit @ np.stack(planes) @ np.linalg.inv(planes[len(planes) // 2]) @ np.linalg.inv(unit)
    scaled /= scaled[:, 2:, 2:]
    own = _observations_of(seen, rows, unit)
    if len(rows) < MIN_DEPTH_FRAMES or len(own.point) < 6 * len(rows):
        return np.linalg.inv(unit) @ np.concatenate([scaled, np.zeros((len(rows), 3, 1))], axis=2), np.zeros((0, 4))
    cameras, points = reconstruct(own, scaled, unit[0, 0])
    return np.linalg.inv(unit) @ cameras, points[_reliable(cameras, points, own, unit[0, 0])]


def _observations_of(seen: Observations, rows: np.ndarray, unit: np.ndarray) -> Observations:
    """Select the observations in `rows`, numbered from 0, in unit coordinates; points with one observation are dropped."""
    inside = (seen.row >= rows[0]) & (seen.row <= rows[-1])
    inside &= np.bincount(seen.point[inside], minlength=int(seen.point.max(initial=0)) + 1)[seen.point] > 1
    if not inside.any():
        return Observations(seen.point[:0], seen.row[:0], seen.xy[:0])
    point = np.unique(seen.point[inside], return_inverse=True)[1]
    return Observations(point, seen.row[inside] - rows[0], cv2.perspectiveTransform(seen.xy[inside][None], unit)[0])


def _reliable(cameras: np.ndarray, points: np.ndarray, seen: Observations, unit_px: float) -> np.ndarray:
    size = np.linalg.norm(reprojection_error(cameras, points, seen), axis=1) / unit_px
    times = np.bincount(seen.point, minlength=len(points))
    mean = np.bincount(seen.point, np.minimum(size, 10), len(points)) / np.maximum(times, 1)
    return (times >= MIN_OBSERVATIONS) & (mean <= MAX_ERROR_PX)


def far_homography(
    before: np.ndarray, after: np.ndarray, static_before: np.ndarray, static_after: np.ndarray
) -> np.ndarray | None:
    """Estimate the homography (3, 3) between two frames that are far apart from SIFT matches; None when too few agree."""
    sift = cv2.SIFT_create(nfeatures=1500)
    both = ((before, static_before), (after, static_after))
    features = [sift.detectAndCompute(grey, static.astype(np.uint8) * 255) for grey, static in both]
    keypoints, descriptors = zip(*features, strict=True)
    if any(found is None or len(found) < 2 for found in descriptors):
        return None
    pairs = cv2.BFMatcher().knnMatch(descriptors[0], descriptors[1], k=2)
    good = [a for a, b in pairs if a.distance < 0.75 * b.distance]
    at = [np.array([keypoints[side][(m.queryIdx, m.trainIdx)[side]].pt for m in good]).reshape(-1, 2) for side in (0, 1)]
    return _homography(at[0], at[1], 4.0)
