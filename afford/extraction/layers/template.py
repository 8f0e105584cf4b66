"""Template tracking of one object: a canvas accumulates its appearance and silhouette, and is aligned with every frame."""

from __future__ import annotations

import copy
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.masks import dilate, iou
from afford.extraction.layers.align import align, signed_distance

MARGIN = 0.35
MEMORY = 0.85
UPDATE_RATE = 0.25
MAX_POINTS = 5000


@dataclass
class Canvas:
    """Template of an object: a grid of evidence around it.

    Grid point (i, j) is the canvas point ((i, j) - centre) / radius of `afford.extraction.layers.align`.
    """

    centre: np.ndarray
    """(2,) grid coordinates of the canvas origin"""
    radius: float
    """grid pixels per canvas unit"""
    seen: np.ndarray
    """(h, w) float32: evidence that the grid point was visible"""
    inside: np.ndarray
    """(h, w) float32: the part of that evidence that shows the object"""
    grey: np.ndarray
    """(h, w) float32: brightness, 0..255"""

    @classmethod
    def around(cls, mask: np.ndarray) -> tuple[Canvas, np.ndarray]:
        """Create an empty canvas around a non-empty (h, w) bool mask, and the pose (2, 3) that maps it onto the mask."""
        x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
        pad = int(MARGIN * max(width, height)) + 4
        size = (height + 2 * pad, width + 2 * pad)
        centre = np.array([(size[1] - 1) / 2, (size[0] - 1) / 2])
        radius = max(width, height) / 2
        blank = [np.zeros(size, np.float32) for _ in range(3)]
        corner = centre + np.array([x - pad, y - pad])
        return cls(centre, radius, *blank), np.array([[radius, 0, corner[0]], [0, radius, corner[1]]])

    def to_pixels(self, pose: np.ndarray) -> np.ndarray:
        """Affine map (2, 3) from grid coordinates to image pixels."""
        linear = pose[:, :2] / self.radius
        return np.column_stack([linear, pose[:, 2] - linear @ self.centre])

    def warp(self, image: np.ndarray, pose: np.ndarray, *, nearest: bool = False) -> np.ndarray:
        """Warp an image (h, w) to the canvas; 0 outside the image."""
        flags = (cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR) | cv2.WARP_INVERSE_MAP
        return cv2.warpAffine(image, self.to_pixels(pose), self.grey.shape[::-1], flags=flags)

    def agreement(self, visible: np.ndarray, known: np.ndarray, pose: np.ndarray) -> float:
        """IoU of the canvas shape and the visible mask, where both are known; 0 when no pixel is known."""
        both = (self.warp(known.view(np.uint8), pose, nearest=True) > 0) & (self.seen > 0.05)
        here = (self.warp(visible.view(np.uint8), pose, nearest=True) > 0) & both
        mine = self.shape() & both
        return iou(here, mine)

    def update(self, grey: np.ndarray, visible: np.ndarray, known: np.ndarray, pose: np.ndarray) -> None:
        """Update the canvas with one frame: grey (h, w) float32, visible and known (h, w) bool."""
        known_here = self.warp(known.view(np.uint8), pose, nearest=True) > 0
        inside_here = (self.warp(visible.view(np.uint8), pose, nearest=True) > 0) & known_here
        grey_here = self.warp(grey, pose)
        fresh = inside_here & (self.inside < 0.05)
        keep = np.where(known_here, np.float32(MEMORY), np.float32(1))
        self.seen = self.seen * keep + known_here
        self.inside = self.inside * keep + inside_here
        self.grey = np.where(fresh, grey_here, np.where(inside_here, self.grey + UPDATE_RATE * (grey_here - self.grey), self.grey))

    def shape(self) -> np.ndarray:
        """Silhouette (h, w) bool: the grid points that most of the evidence assigns to the object."""
        return self.inside > 0.5 * self.seen

    def samples(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sample points (m, 2), appearance (m, 2) and distance (m, 2), float32, for `align`; m is at most about MAX_POINTS."""
        shape, known = self.shape(), self.seen > 0.05
        distance, weight = signed_distance(shape & known, known)
        stride = max(1, int(np.ceil(np.sqrt(shape.size / MAX_POINTS))))
        y, x = np.mgrid[0 : shape.shape[0] : stride, 0 : shape.shape[1] : stride].reshape(2, -1)
        points = (np.stack([x, y], axis=1) - self.centre) / self.radius
        appearance = np.stack([self.grey[y, x], shape[y, x]], axis=1)
        return points.astype(np.float32), appearance.astype(np.float32), np.stack([distance[y, x], weight[y, x]], axis=1)


LEVELS = ((3.0, 8), (1.0, 8))
"""blur of the image (sigma, px) and Gauss-Newton steps, coarse to fine"""
SHIFT, TURN, SCALE, SHEAR = 0.1, 1.0, 30.0, 15.0
"""stiffness of a pose around the expected one, in samples per px^2: objects move and rotate freely, but hardly deform"""
FIRST = 0.3
"""stiffness of scale and shear around those of the first frame"""
MIN_PIXELS = 25
UPDATE_MIN_FIT = 0.6
"""least agreement at which a frame updates the canvas"""


def _stiffness(scale: float, shear: float, turn: float, shift: float) -> np.ndarray:
    """Build the stiffness matrix (6, 6) over the entries of a pose, row by row."""
    modes = [(scale, [1, 0, 0, 0, 1, 0]), (shear, [1, 0, 0, 0, -1, 0]), (shear, [0, 1, 0, 1, 0, 0]), (turn, [0, -1, 0, 1, 0, 0]),
             (shift, [0, 0, 1, 0, 0, 0]), (shift, [0, 0, 0, 0, 0, 1])]  # fmt: skip
    return sum(weight * np.outer(mode, mode) / np.dot(mode, mode) for weight, mode in modes)


STIFFNESS_LAST, STIFFNESS_FIRST = _stiffness(SCALE, SHEAR, TURN, SHIFT), _stiffness(FIRST, FIRST, 0, 0)


@dataclass(frozen=True)
class PoseTrack:
    """Poses of an object in every frame."""

    poses: np.ndarray
    """(t, 2, 3) float64, canvas points to pixels"""
    fit: np.ndarray
    """(t,) float32 in 0..1: agreement of the posed template with the visible mask; 0 where the object was not found"""


def track_template(grey: np.ndarray, visible: np.ndarray, hidden_by: np.ndarray) -> PoseTrack:
    """Track the object with the masks `visible` (t, h, w) bool, which `hidden_by` (t, h, w) bool may occlude.

    grey: (t, h, w) uint8. Tracking starts in the frame that shows most of the object, and runs forwards and backwards.
    """
    count = len(grey)
    poses, fit = np.tile(np.eye(2, 3), (count, 1, 1)), np.zeros(count, np.float32)
    best = reference_frame(visible, hidden_by)
    if best < 0:
        return PoseTrack(poses, fit)
    canvas, poses[best] = Canvas.around(visible[best])
    fit[best] = 1
    known = ~hidden_by
    canvas.update(grey[best].astype(np.float32), visible[best], known[best], poses[best])
    for order in (range(best + 1, count), range(best - 1, -1, -1)):
        _track_direction(copy.copy(canvas), order, grey, visible, known, poses, fit, best)
    return PoseTrack(poses, fit)


def reference_frame(visible: np.ndarray, hidden_by: np.ndarray) -> int:
    """Find the frame that shows most of the outline and area of the object; -1 when no frame shows it."""
    scores = [_visibility_score(mask, cover) for mask, cover in zip(visible, hidden_by, strict=True)]
    return int(np.argmax(scores)) if max(scores, default=0) > 0 else -1


def _visibility_score(mask: np.ndarray, cover: np.ndarray) -> float:
    area = np.count_nonzero(mask)
    if area < MIN_PIXELS:
        return 0.0
    ring = dilate(mask, 2) & ~mask
    frame = mask[0].sum() + mask[-1].sum() + mask[:, 0].sum() + mask[:, -1].sum()
    closed = (np.count_nonzero(ring & cover) / 2 + frame) / max(np.count_nonzero(ring) / 2 + frame, 1)
    return float(area * (1 - closed) ** 3 + 1e-6 * area)


def _track_direction(
    canvas: Canvas, order: Iterable[int], grey: np.ndarray, visible: np.ndarray, known: np.ndarray,
    poses: np.ndarray, fit: np.ndarray, last: int,
) -> None:  # fmt: skip
    before = last
    for t in order:
        poses[t] = poses[last]
        if np.count_nonzero(visible[t]) >= MIN_PIXELS:
            starts = [poses[last], propagate_pose(poses[last], grey[last], grey[t], visible[last], visible[t])]
            if before != last:
                starts.append(2 * poses[last] - poses[before])
            poses[t], fit[t] = _align_frame(canvas, starts, grey[t], visible[t], known[t])
            if fit[t] > UPDATE_MIN_FIT:
                canvas.update(grey[t].astype(np.float32), visible[t], known[t], poses[t])
        before, last = last, t


def propagate_pose(
    pose: np.ndarray, before: np.ndarray, after: np.ndarray, visible: np.ndarray, visible_after: np.ndarray
) -> np.ndarray:
    """Move a pose (2, 3) by the motion of corners inside a mask; with too few corners the pose is unchanged.

    before, after: (h, w) uint8 grey images. visible, visible_after: (h, w) bool, the mask in each.
    """
    corners = cv2.goodFeaturesToTrack(before, 40, 0.01, 3, mask=visible.view(np.uint8) * 255)
    if corners is None or len(corners) < 4:
        return pose
    there, ok, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, None, winSize=(11, 11), maxLevel=2)
    x, y = np.rint(there[:, 0]).astype(int).T.clip(0, np.array([[after.shape[1] - 1], [after.shape[0] - 1]]))
    good = (ok[:, 0] > 0) & visible_after[y, x]
    if good.sum() < 4:
        return pose
    motion, _ = cv2.estimateAffinePartial2D(corners[good], there[good], method=cv2.RANSAC, ransacReprojThreshold=1.5)
    if motion is None:
        return pose
    return np.column_stack([motion[:, :2] @ pose[:, :2], motion @ np.append(pose[:, 2], 1)])


def _refine(
    points: np.ndarray, appearance: np.ndarray, distance: np.ndarray, image: np.ndarray, outline: np.ndarray,
    pose: np.ndarray, steps: int, radius: float,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """Align from `pose`; priors keep it near `pose`, and its scale and shear near those of the first frame."""
    turn = np.arctan2(pose[1, 0] - pose[0, 1], pose[0, 0] + pose[1, 1])
    first = pose.copy()
    first[:, :2] = radius * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    both = STIFFNESS_LAST + STIFFNESS_FIRST
    expected = np.linalg.solve(both, STIFFNESS_LAST @ pose.ravel() + STIFFNESS_FIRST @ first.ravel()).reshape(2, 3)
    return align(points, appearance, distance, image, outline, pose, expected, steps, both)


def _align_frame(
    canvas: Canvas, starts: list[np.ndarray], grey: np.ndarray, visible: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, float]:
    points, appearance, distance = canvas.samples()
    (x, y, width, height), corner = _window(canvas, starts, visible)
    cut = np.s_[y : y + height, x : x + width]
    candidates = [start - corner for start in starts]
    for sigma, steps in LEVELS:
        image = _brightness(grey[cut], visible[cut], sigma)
        outline = _with_gradient(*signed_distance(visible[cut], known[cut]))
        found = [_refine(points, appearance, distance, image, outline, pose, steps, canvas.radius) for pose in candidates]
        candidates = [min(found, key=lambda item: item[1])[0]]
    pose = candidates[0] + corner
    return pose, canvas.agreement(visible, known, pose)


def _window(canvas: Canvas, starts: list[np.ndarray], visible: np.ndarray) -> tuple[tuple[int, int, int, int], np.ndarray]:
    """Box (x, y, width, height) around the mask and the canvas, and the offset (2, 3) to subtract from poses inside it."""
    box = cv2.boundingRect(visible.view(np.uint8))
    corners = [(box[0], box[1]), (box[0] + box[2], box[1] + box[3])]
    for pose in starts:
        reach = np.abs(pose[:, :2]).sum(axis=1)
        corners += [tuple(pose[:, 2] - reach), tuple(pose[:, 2] + reach)]
    low = np.clip(np.floor(np.min(corners, axis=0)) - 12, 0, [visible.shape[1] - 2, visible.shape[0] - 2]).astype(int)
    high = np.clip(np.ceil(np.max(corners, axis=0)) + 12, low + 2, [visible.shape[1], visible.shape[0]]).astype(int)
    offset = np.array([[0, 0, low[0]], [0, 0, low[1]]], float)
    return (int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])), offset


def _brightness(grey: np.ndarray, visible: np.ndarray, sigma: float) -> np.ndarray:
    weight = visible.astype(np.float32)
    share = cv2.GaussianBlur(weight, (0, 0), sigma)
    smooth = cv2.GaussianBlur(grey.astype(np.float32) * weight, (0, 0), sigma) / np.maximum(share, 1e-3)
    return _with_gradient(smooth, weight * (share > 0.5))


def _with_gradient(value: np.ndarray, weight: np.ndarray) -> np.ndarray:
    value = value.astype(np.float32)
    dx = cv2.Sobel(value, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    dy = cv2.Sobel(value, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    return np.ascontiguousarray(np.stack([value, dx, dy, weight.astype(np.float32)], axis=-1))
