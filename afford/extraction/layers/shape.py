"""The complete shape of a followed object: what other frames, laid over this one, say about the pixels that are hidden here."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np

from afford.common.masks import dilate
from afford.extraction.layers.appearance import gather_votes
from afford.extraction.layers.follow import MIN_PIXELS, Path, carried
from schemas.masks import Tracks
from schemas.video import SIDES

RECALL_FRAMES = 48.0
MIN_FIT = 0.6
MAJORITY = 0.65
SEEN = 0.02
"""a pixel that less than this share of the frames, by weight, has seen was never seen"""
RIM_PX = 2
"""how far the visible pixels that a bridge rests on may lie from what it bridges"""
BRIDGE_TRUST = 0.25
"""confidence of a pixel for which a bridge alone speaks"""


def complete_shape(
    path: Path, frame: np.ndarray, visible: np.ndarray, hidden_by: np.ndarray, unknown: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Complete masks (t, h, w) bool, and confidence (t,) float32: how sure the hidden pixels are, 1 where none is hidden.

    frame: (t,) frame numbers. visible, hidden_by: (t, h, w) bool. A hidden pixel belongs to the object when most of the other
    frames, nearer ones counting more, have seen the object there. What no frame has seen, all of it where the object could
    not be followed, is bridged from rim to rim, but only inside `unknown` (t, h, w) bool; without it inside `hidden_by`.
    """
    complete, confidence = visible.copy(), np.zeros(len(frame), np.float32)
    cameras, known = as_cameras(path.poses), ~hidden_by
    unknown = hidden_by if unknown is None else unknown
    for t in np.flatnonzero(visible.any(axis=(1, 2)) | (path.fit >= MIN_FIT)):
        followed = path.fit[t] >= MIN_FIT
        pixels = _candidates(path.poses[t], visible[t], hidden_by[t], followed)
        rows, weights = recall(path, frame, int(t)) if followed else (np.zeros(0, np.int64), np.zeros(0))
        yes, seen = gather_votes(on_canvas(path.poses[t], pixels), cameras[rows], rows, weights, visible, known)
        told = seen > SEEN * weights.sum()
        mine = told & (yes > MAJORITY * seen)
        _mark(complete[t], pixels[mine])
        unseen = _mark(np.zeros_like(visible[t]), pixels[~told]) & unknown[t]
        bridged = bridge(complete[t], unseen)
        complete[t] |= bridged
        sure = np.append((2 * yes[mine] / seen[mine] - 1) * seen[mine].clip(0, 1), np.full(bridged.sum(), BRIDGE_TRUST))
        trust = float(path.fit[t]) if followed else 1.0
        confidence[t] = trust * (float(sure.mean()) if len(sure) else 1.0 if followed else BRIDGE_TRUST)
    return complete, confidence


def bridge(inside: np.ndarray, unseen: np.ndarray) -> np.ndarray:
    """(h, w) bool: the pixels of `unseen` that lie between parts of the shape.

    inside, unseen: (h, w) bool, disjoint. Each connected region of `unseen` is crossed by the convex hull of the inside pixels
    at its own rim: a finger over a handle is bridged by a piece of handle, whatever else belongs to the object.
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


def recall(path: Path, frame: np.ndarray, t: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows (n,) int64 of the frames to ask about frame `t`, and their weights (n,) float64: fit, fading with time."""
    rows = np.flatnonzero(path.fit >= MIN_FIT)
    rows = rows[rows != t]
    return rows, path.fit[rows] ** 2 * (0.02 + np.exp(-np.abs(frame[rows] - frame[t]) / RECALL_FRAMES))


def as_cameras(poses: np.ndarray) -> np.ndarray:
    """(t, 3, 4) cameras for `afford.extraction.layers.appearance` from (t, 2, 3) poses."""
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


def _mark(mask: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    mask[pixels[:, 1], pixels[:, 0]] = True
    return mask


GLIMPSE = 0.25
"""less than this share of the largest visible areas (their 0.9 quantile) is too little to place an object by"""
CARRIED_FIT = 0.6
"""fit of a carried pose: just enough to complete the object with it"""


def holding(tracks: Tracks, index: int) -> np.ndarray:
    """(t, h, w) bool: visible pixels of the hands that touch object `index` in each frame."""
    out = np.zeros(tracks.masks.shape[1:], bool)
    for entity, mask in zip(tracks.entities, tracks.masks, strict=True):
        if entity.role == "hand":
            out |= mask & (tracks.contact[SIDES.index(entity.side)] == index)[:, None, None]
    return out


def carry(path: Path, grey: np.ndarray, visible: np.ndarray, hand: np.ndarray) -> Path:
    """The path with new poses for frames that only glimpse the object, held and between two that show it.

    grey: (t, h, w) uint8. visible, hand: (t, h, w) bool, the object and what holds it. The pose of the last frame before is
    carried forwards by the motion of both, that of the first after backwards, and the two are blended by their distance.
    """
    area = np.count_nonzero(visible, axis=(1, 2))
    if not area.any():
        return path
    shown = np.flatnonzero((path.fit > 0) & (area >= max(MIN_PIXELS, GLIMPSE * np.quantile(area[area > 0], 0.9))))
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
            fit[start + 1 + step] = CARRIED_FIT
    return replace(path, poses=poses, fit=fit)


def _chain(pose: np.ndarray, order: range, grey: np.ndarray, mask: np.ndarray) -> list[np.ndarray]:
    """Poses in the frames of `order` after the first, where the pose is given."""
    out = []
    for before, after in pairwise(order):
        pose = carried(pose, grey[before], grey[after], mask[before], mask[after])
        out.append(pose)
    return out
