"""The complete shape of a followed object: what other frames, laid over this one, say about the pixels that are hidden here."""

from __future__ import annotations

import cv2
import numpy as np

from afford.layers.follow import Path
from afford.layers.gather import gather_votes

RECALL_FRAMES = 12.0
MIN_FIT = 0.6
MAJORITY = 0.55
HULL_VOTE = 0.3
"""weight of the convex hull of the shape, which decides where no frame has seen the point"""
HULL_TRUST = 0.25
"""confidence of a pixel for which the hull alone speaks"""


def complete_shape(path: Path, frame: np.ndarray, visible: np.ndarray, hidden_by: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Complete masks (t, h, w) bool, and confidence (t,) float32: how sure the hidden pixels are, 1 where none is hidden.

    frame: (t,) frame numbers. visible, hidden_by: (t, h, w) bool. A hidden pixel belongs to the object when most of the other
    frames, nearer ones counting more, have seen the object there. In frames that it could not be followed to, and for pixels
    that were never seen, the convex hull decides.
    """
    complete, confidence = visible.copy(), np.zeros(len(frame), np.float32)
    cameras = as_cameras(path.poses)
    known = ~hidden_by
    for t in np.flatnonzero(visible.any(axis=(1, 2)) | (path.fit >= MIN_FIT)):
        followed = path.fit[t] >= MIN_FIT
        pixels = _candidates(path.poses[t], visible[t], hidden_by[t], followed)
        rows, weights = recall(path, frame, int(t)) if followed else (np.zeros(0, np.int64), np.zeros(0))
        points = on_canvas(path.poses[t], pixels)
        yes, seen = gather_votes(points, cameras[rows], rows, weights, visible, known)
        hull = _in_hull(points, yes > 0.5 * seen, pixels, visible[t])
        share = (yes + HULL_VOTE * hull) / (seen + HULL_VOTE)
        mine = pixels[share > MAJORITY]
        complete[t, mine[:, 1], mine[:, 0]] = True
        sure = np.abs(share - 0.5) * 2 * np.clip(seen, HULL_TRUST, 1)
        trust = float(path.fit[t]) if followed else 1.0
        confidence[t] = trust * (float(sure[share > MAJORITY].mean()) if len(mine) else 1.0 if followed else HULL_TRUST)
    return complete, confidence


def recall(path: Path, frame: np.ndarray, t: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows (n,) int64 of the frames to ask about frame `t`, and their weights (n,) float64: fit, fading with time."""
    rows = np.flatnonzero(path.fit >= MIN_FIT)
    rows = rows[rows != t]
    return rows, path.fit[rows] ** 2 * (0.02 + np.exp(-np.abs(frame[rows] - frame[t]) / RECALL_FRAMES))


def as_cameras(poses: np.ndarray) -> np.ndarray:
    """(t, 3, 4) cameras for `afford.layers.gather` from (t, 2, 3) poses."""
    cameras = np.zeros((len(poses), 3, 4))
    cameras[:, :2, :3] = poses
    cameras[:, 2, 2] = 1
    return cameras


def on_canvas(pose: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Homogeneous canvas points (m, 4) of pixels (m, 2) x, y under a pose (2, 3)."""
    canvas = np.linalg.solve(pose[:, :2], (pixels - pose[:, 2]).T).T
    return np.column_stack([canvas, np.ones(len(pixels)), np.zeros(len(pixels))])


def _candidates(pose: np.ndarray, visible: np.ndarray, hidden_by: np.ndarray, followed: bool) -> np.ndarray:
    """Pixels (m, 2) x, y that are hidden, in the box of the visible mask and, when followed, of the canvas."""
    reach = np.abs(pose[:, :2]).sum(axis=1) * 1.35 + 4
    x, y, width, height = cv2.boundingRect(visible.view(np.uint8))
    if not followed:
        rows, columns = np.nonzero(hidden_by[y : y + height, x : x + width])
        return np.stack([columns + x, rows + y], axis=1)
    low = np.minimum(pose[:, 2] - reach, [x, y]).astype(int).clip(0)
    high = np.maximum(pose[:, 2] + reach, [x + width, y + height]).astype(int) + 1
    rows, columns = np.nonzero(hidden_by[low[1] : high[1], low[0] : high[0]])
    return np.stack([columns + low[0], rows + low[1]], axis=1)


def _in_hull(points: np.ndarray, inside: np.ndarray, pixels: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """(m,) bool: which of the hidden pixels lie in the convex hull of the visible mask and the pixels called inside."""
    shape = visible.astype(np.uint8)
    shape[pixels[inside, 1], pixels[inside, 0]] = 1
    corners = cv2.findNonZero(shape)
    if corners is None:
        return inside
    filled = cv2.fillConvexPoly(np.zeros(visible.shape, np.uint8), cv2.convexHull(corners), 1)
    return filled[pixels[:, 1], pixels[:, 0]] > 0
