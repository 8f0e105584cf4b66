"""Corners of the background, followed through a clip (Kanade-Lucas-Tomasi)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

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
