"""Candidates for what a hand touches in one sampled frame: outlines at points beside the fingers, and features to rank them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.masks import dilate, erode
from afford.extraction.hands.grip import grip_ring, palm_size_px
from afford.extraction.hands.moving_objects import LARGEST
from afford.extraction.prompted import AtPoint

POINTS = 12
"""points at which a picture is segmented for one hand"""
GRIP_TIPS = (4, 8, 12)
"""keypoints around the usual place of a held object: tips of thumb, index and middle finger"""
RING, LEAST_RING_PX, MARGIN_PX = 0.25, 4, 2
"""points lie around the hand up to this share of the palm, at least so many px, and so far from any hand"""
LEAST_PX, LEAST_SIZE = 30, 0.03
"""least area of a candidate, in pixels and as a share of the squared size of the palm"""
SAME, ALIKE = 0.85, 0.7
"""IoU from which two candidates are one, and from which the outline at another point agrees with a candidate"""
PALM_SHARE = 0.6
"""size of the palm of a hand without keypoints, as a share of the root of its area"""
FAR_SIZE, MAX_DISTANCE = 3.0, 5.0
"""distance of what is far from the hand, and largest distance of a centre, in sizes of the palm"""
STEADY = 1.0
"""an outline is stable when raising and lowering its threshold by this much changes little"""
SURE_ODDS = 1.0
"""log odds from which a pixel counts as one of a touched object"""
FEATURES = ("quality", "stable", "size", "size squared", "picture border", "hand inside hull", "ring covered", "unexplained",
            "along", "agreement", "distance", "far")  # fmt: skip


@dataclass(frozen=True, eq=False)
class Grip:
    """A hand in one sampled frame and the evidence around it; arrays are (h, w)."""

    hand: np.ndarray
    hands: np.ndarray
    """all hands, bool"""
    arms: np.ndarray
    """forearms and sleeves, bool"""
    points: np.ndarray | None
    """keypoints (21, 2), px"""
    odds: np.ndarray
    """log odds of a touched object, float32"""
    along: np.ndarray
    """motion with the hand, float32, -1 to 1"""

    @property
    def size_px(self) -> float:
        """Size of the palm."""
        return palm_size_px(self.points) if self.points is not None else max(8.0, PALM_SHARE * float(np.sqrt(self.hand.sum())))

    @property
    def centre(self) -> np.ndarray:
        """Centre (2,) x, y of the grip."""
        if self.points is not None:
            return np.asarray(self.points[list(GRIP_TIPS)].mean(0))
        return np.array([at.mean() for at in np.nonzero(self.hand)[::-1]])

    def ring(self) -> np.ndarray:
        """Surroundings (h, w) bool of the fingers."""
        return grip_ring(self.hand, self.points, max(LEAST_RING_PX, round(RING * self.size_px))) & ~self.hands


@dataclass(frozen=True, eq=False)
class Candidates:
    """Outlines that a hand may touch."""

    masks: np.ndarray
    """(n, h, w) bool, without hands"""
    features: np.ndarray
    """(n, len(FEATURES)) float32"""


@dataclass(frozen=True, eq=False)
class _Outline:
    mask: np.ndarray
    """(h, w) bool, without hands"""
    quality: float
    stable: float
    point: int
    """index of the point at which it was segmented"""


def touch_candidates(at: AtPoint, grip: Grip) -> Candidates:
    """Segment the picture beside the fingers of a hand."""
    ring = grip.ring()
    found = [one for i, point in enumerate(prompts(grip, ring)) for one in _outlines(at, point, i, grip, ring)]
    if not found:
        return Candidates(np.zeros((0, *grip.hand.shape), bool), np.zeros((0, len(FEATURES)), np.float32))
    overlap = _overlaps([one.mask for one in found])
    points = np.array([one.point for one in found])
    chosen, distinct = list[int](), np.ones(len(found), bool)
    for i in sorted(range(len(found)), key=lambda i: -found[i].quality):
        if distinct[i]:
            chosen.append(i)
            distinct &= overlap[i] < SAME
    agreement = [len(set(points[overlap[i] >= ALIKE].tolist())) / POINTS for i in chosen]
    rows = [_features(found[i], grip, ring, share) for i, share in zip(chosen, agreement, strict=True)]
    return Candidates(np.stack([found[i].mask for i in chosen]), np.array(rows, np.float32))


def prompts(grip: Grip, ring: np.ndarray) -> list[tuple[float, float]]:
    """Spread points over the surroundings of the fingers, the first one in the middle of the grip."""
    free = ring & ~dilate(grip.hands, MARGIN_PX)
    free = free & ~grip.arms if (free & ~grip.arms).any() else free
    y, x = np.nonzero(free)
    if not len(y):
        return []
    centre = grip.centre
    chosen, away = [int(np.hypot(x - centre[0], y - centre[1]).argmin())], np.full(len(y), np.inf)
    for _ in range(POINTS - 1):
        away = np.minimum(away, np.hypot(x - x[chosen[-1]], y - y[chosen[-1]]))
        chosen.append(int(away.argmax()))
    return [(float(x[i]), float(y[i])) for i in dict.fromkeys(chosen)]


def _outlines(at: AtPoint, point: tuple[float, float], i: int, grip: Grip, ring: np.ndarray) -> list[_Outline]:
    out, (logits, quality) = [], at(point)
    for image, expected in zip(logits, quality.tolist(), strict=True):
        mask = (image > 0) & ~grip.hands
        area = int(mask.sum())
        if max(LEAST_PX, LEAST_SIZE * grip.size_px**2) <= area <= LARGEST * mask.size and (mask & ring).any():
            stable = (image > STEADY).sum() / max((image > -STEADY).sum(), 1)
            out.append(_Outline(mask, expected, float(stable), i))
    return out


def _overlaps(masks: Sequence[np.ndarray]) -> np.ndarray:
    """Compute the IoU (n, n) of all pairs at half the size."""
    size = (masks[0].shape[1] // 2, masks[0].shape[0] // 2)
    flat = np.stack([cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA).ravel() for mask in masks])
    both = flat @ flat.T
    area = np.square(flat).sum(1)
    return np.asarray(both / (area[:, None] + area[None] - both + 1e-6))


def _features(one: _Outline, grip: Grip, ring: np.ndarray, agreement: float) -> list[float]:
    """Compute FEATURES of an outline."""
    mask, size = one.mask, grip.size_px
    area = float(mask.sum())
    frame = mask.copy()
    frame[1:-1, 1:-1] = False
    edge = frame | mask & ~erode(mask, 1)
    away = cv2.distanceTransform((~grip.hand).astype(np.uint8), cv2.DIST_L2, 3)
    y, x = np.nonzero(mask)
    distance = np.hypot(x.mean() - grip.centre[0], y.mean() - grip.centre[1]) / size
    log_size = np.log(area / size**2)
    return [one.quality, one.stable, log_size, log_size**2, frame.sum() / max(edge.sum(), 1), _hand_inside_hull(mask, grip.hand),
            (mask & ring).sum() / max(ring.sum(), 1), (grip.odds[mask] > SURE_ODDS).mean(), grip.along[mask].mean(), agreement,
            min(distance, MAX_DISTANCE), (away[mask] > FAR_SIZE * size).mean()]  # fmt: skip


def _hand_inside_hull(mask: np.ndarray, hand: np.ndarray) -> float:
    """Share of the hand inside the convex hull of a mask: near 1 for a table under the hand."""
    lines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    hull = np.zeros(mask.shape, np.uint8)
    cv2.fillConvexPoly(hull, cv2.convexHull(np.concatenate(lines)), 1)
    return float(hull[hand].mean())
