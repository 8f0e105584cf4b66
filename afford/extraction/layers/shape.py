"""Complete shape of a tracked object: other frames, aligned with this one, vote on its hidden pixels."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np

from afford.common.masks import dilate
from afford.extraction.layers.appearance import gather_votes
from afford.extraction.layers.template import MIN_PIXELS, PoseTrack, propagate_pose
from schemas.masks import Tracks
from schemas.video import SIDES

SOURCE_FRAMES = 48.0
MIN_FIT = 0.6
MAJORITY = 0.65
MIN_SEEN_SHARE = 0.02
"""a pixel counts as seen when at least this share of the frames, by weight, shows it"""
RIM_PX = 2
"""largest distance between the visible pixels at the rim of a bridge and the bridge"""
BRIDGE_CONFIDENCE = 0.25
"""confidence of a bridged pixel"""


def complete_shape(
    path: PoseTrack, frame: np.ndarray, visible: np.ndarray, hidden_by: np.ndarray, unknown: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Compute complete masks (t, h, w) bool, and their confidence (t,) float32: that of the hidden pixels, 1 without any.

    frame: (t,) frame numbers. visible, hidden_by: (t, h, w) bool. A hidden pixel belongs to the object when a weighted majority
    of the other frames shows the object there; nearer frames have a larger weight. Pixels that no frame shows, and all hidden
    pixels where tracking failed, are bridged from rim to rim, but only inside `unknown` (t, h, w) bool, by default `hidden_by`.
    """
    complete, confidence = visible.copy(), np.zeros(len(frame), np.float32)
    cameras, known = as_cameras(path.poses), ~hidden_by
    unknown = hidden_by if unknown is None else unknown
    for t in np.flatnonzero(visible.any(axis=(1, 2)) | (path.fit >= MIN_FIT)):
        tracked = path.fit[t] >= MIN_FIT
        pixels = _candidates(path.poses[t], visible[t], hidden_by[t], tracked)
        rows, weights = source_frames(path, frame, int(t)) if tracked else (np.zeros(0, np.int64), np.zeros(0))
        yes, seen = gather_votes(on_canvas(path.poses[t], pixels), cameras[rows], rows, weights, visible, known)
        known_here = seen > MIN_SEEN_SHARE * weights.sum()
        inside = known_here & (yes > MAJORITY * seen)
        _mark(complete[t], pixels[inside])
        unseen = _mark(np.zeros_like(visible[t]), pixels[~known_here]) & unknown[t]
        bridged = bridge(complete[t], unseen)
        complete[t] |= bridged
        voted = (2 * yes[inside] / seen[inside] - 1) * seen[inside].clip(0, 1)
        certainty = np.append(voted, np.full(bridged.sum(), BRIDGE_CONFIDENCE))
        fit = float(path.fit[t]) if tracked else 1.0
        confidence[t] = fit * (float(certainty.mean()) if len(certainty) else 1.0 if tracked else BRIDGE_CONFIDENCE)
    return complete, confidence


def bridge(inside: np.ndarray, unseen: np.ndarray) -> np.ndarray:
    """Find the pixels of `unseen` between parts of the shape, (h, w) bool.

    inside, unseen: (h, w) bool, disjoint. Each connected region of `unseen` is filled by the convex hull of the inside pixels at
    its own rim: a piece of handle bridges a finger over the handle, independently of the rest of the object.
    """
    out = np.zeros_like(inside)
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(unseen.view(np.uint8))
    for label, (x, y, width, height, _) in enumerate(boxes[1:], start=1):
        cut = np.s_[max(y - RIM_PX, 0) : y + height + RIM_PX, max(x - RIM_PX, 0) : x + width + RIM_PX]
        region = labels[cut] == label
        rim = cv2.findNonZero((dilate(region, RIM_PX) & inside[cut]).view(np.uint8))
        if rim is not None:
            hull = cv2.fillConvexPoly(np.zeros(region.shape, np.uint8), cv2.convexHull(rim), 1) > 0
            out[cut] |= hull & region
    return out


def source_frames(path: PoseTrack, frame: np.ndarray, t: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows (n,) int64 of the frames that vote on frame `t`, and their weights (n,) float64: fit, decaying with time."""
    rows = np.flatnonzero(path.fit >= MIN_FIT)
    rows = rows[rows != t]
    return rows, path.fit[rows] ** 2 * (0.02 + np.exp(-np.abs(frame[rows] - frame[t]) / SOURCE_FRAMES))


def as_cameras(poses: np.ndarray) -> np.ndarray:
    """Convert poses (t, 2, 3) to cameras (t, 3, 4) for `afford.extraction.layers.appearance`."""
    cameras = np.zeros((len(poses), 3, 4))
    cameras[:, :2, :3] = poses
    cameras[:, 2, 2] = 1
    return cameras


def on_canvas(pose: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """Map pixels (m, 2) x, y to homogeneous canvas points (m, 4) by the inverse of a pose (2, 3)."""
    canvas = np.linalg.solve(pose[:, :2], (pixels - pose[:, 2]).T).T
    return np.column_stack([canvas, np.ones(len(pixels)), np.zeros(len(pixels))])


def _candidates(pose: np.ndarray, visible: np.ndarray, hidden_by: np.ndarray, tracked: bool) -> np.ndarray:
    """Hidden pixels (m, 2) x, y in the box of the visible mask and, where tracked, of the canvas."""
    reach = np.abs(pose[:, :2]).sum(axis=1) * 1.35 + 4
    x, y, width, height = cv2.boundingRect(visible.view(np.uint8))
    if not tracked:
        rows, columns = np.nonzero(hidden_by[y : y + height, x : x + width])
        return np.stack([columns + x, rows + y], axis=1)
    low = np.minimum(pose[:, 2] - reach, [x, y]).astype(int).clip(0)
    high = np.maximum(pose[:, 2] + reach, [x + width, y + height]).astype(int) + 1
    rows, columns = np.nonzero(hidden_by[low[1] : high[1], low[0] : high[0]])
    return np.stack([columns + low[0], rows + low[1]], axis=1)


def _mark(mask: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    mask[pixels[:, 1], pixels[:, 0]] = True
    return mask


MIN_VISIBLE_SHARE = 0.25
"""least visible area that fixes the pose of an object, as a share of the 0.9 quantile of its visible areas"""
PROPAGATED_FIT = 0.6
"""fit of a propagated pose: just enough to complete the object with it"""


def holding_hands(tracks: Tracks, index: int) -> np.ndarray:
    """Visible masks (t, h, w) bool of the hands that touch object `index` in each frame."""
    out = np.zeros(tracks.masks.shape[1:], bool)
    for entity, mask in zip(tracks.entities, tracks.masks, strict=True):
        if entity.role == "hand":
            out |= mask & (tracks.contact[SIDES.index(entity.side)] == index)[:, None, None]
    return out


def propagate_while_held(path: PoseTrack, grey: np.ndarray, visible: np.ndarray, hand: np.ndarray) -> PoseTrack:
    """Propagate poses to frames in which a hand holds the object and hides most of it, between two frames that show it.

    grey: (t, h, w) uint8. visible, hand: (t, h, w) bool, the object and the hands that hold it. The pose of the last frame before
    is propagated forwards by the motion of both, that of the first frame after backwards; they are blended by distance.
    """
    area = np.count_nonzero(visible, axis=(1, 2))
    if not area.any():
        return path
    shown = np.flatnonzero((path.fit > 0) & (area >= max(MIN_PIXELS, MIN_VISIBLE_SHARE * np.quantile(area[area > 0], 0.9))))
    held = np.asarray(hand.any(axis=(1, 2)))
    both = hand | visible
    poses, fit = path.poses.copy(), path.fit.copy()
    for start, stop in pairwise(shown.tolist()):
        if not held[start + 1 : stop].any():
            continue
        forwards = _chain(path.poses[start], range(start, stop), grey, both)
        backwards = _chain(path.poses[stop], range(stop, start, -1), grey, both)[::-1]
        for step in np.flatnonzero(held[start + 1 : stop]).tolist():
            share = (step + 1) / (stop - start)
            poses[start + 1 + step] = (1 - share) * forwards[step] + share * backwards[step]
            fit[start + 1 + step] = PROPAGATED_FIT
    return replace(path, poses=poses, fit=fit)


def _chain(pose: np.ndarray, order: range, grey: np.ndarray, mask: np.ndarray) -> list[np.ndarray]:
    """Propagate a pose, given in the first frame of `order`, to the other frames of `order`."""
    out = []
    for before, after in pairwise(order):
        pose = propagate_pose(pose, grey[before], grey[after], mask[before], mask[after])
        out.append(pose)
    return out
