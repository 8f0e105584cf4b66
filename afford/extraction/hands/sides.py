"""Segments of hands, and the side of each track of a hand: left or right, constant over its life."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from afford.extraction.hands.part_tracks import Segment, Track
from afford.extraction.hands.refine import components
from afford.extraction.landmarks.geometry import WRIST, arm_direction
from schemas.video import SIDES, Hand

BLUR_PX = 6.0
"""blur of the side score"""
SURE = 0.3
"""least absolute side score of a certain side"""
RESTING, PACE_PX = 0.05, 1.0
"""weight of a resting pixel as evidence for a hand, against 1 for a pixel of at least this speed (px of half the size)"""

ARM, EGO_HAND, FACING_HAND = 0.6, 0.2, 0.4
"""weights of the direction of the arm, and of the landmark model's handedness, which errs more often for head cameras"""
LEAST_DOWN = 0.2
"""least component of the forearm towards the person's side of the picture"""


@dataclass(frozen=True)
class SidePrior:
    """Prior on the side of a hand from its position."""

    facing: bool
    """the person is seen from the front: the left hand is on the right, and arms enter from above"""
    order: float
    """weight of the order of hands from left to right, against 1 for the hand finder"""
    entry: float
    """weight of the side at which the arm enters the picture"""

    @property
    def sign(self) -> int:
        """1 if the left hand is on the left of the picture, else -1."""
        return -1 if self.facing else 1

    def enters(self, mask: np.ndarray) -> float:
        """Score the position at which a segment (h, w) leaves the picture: -1 right of the person, 1 left; 0 inside."""
        width = mask.shape[1]
        near, far = (mask[0], mask[-1]) if self.facing else (mask[-1], mask[0])
        across = [np.flatnonzero(near), np.zeros(mask[:, 0].sum()), np.full(mask[:, -1].sum(), width - 1)]
        x = np.concatenate(across) if sum(map(len, across)) else np.flatnonzero(far)
        return float(self.sign * np.clip(2 - 4 * x.mean() / (width - 1), -1, 1)) if len(x) else 0.0


    def arm_enters(self, points_px: np.ndarray, width_px: int, height_px: int) -> float:
        """Score the position at which the forearm of a hand with keypoints (21, 2) would enter the picture: -1 right, 1 left.

        0 where the forearm points away from the person's side of the picture: the hand reaches back, or is not the person's.
        """
        wrist, along = points_px[WRIST], arm_direction(points_px)
        down = -1 if self.facing else 1
        if along[1] * down < LEAST_DOWN:
            return float(-self.sign * np.sign(along[0])) if abs(along[0]) > 1 - LEAST_DOWN else 0.0
        border = 0 if self.facing else height_px - 1
        x = wrist[0] + along[0] / along[1] * (border - wrist[1])
        return float(self.sign * np.clip(1 - 2 * x / (width_px - 1), -1, 1))

    def landmark_score(self, points_px: np.ndarray, right: float, width_px: int, height_px: int) -> float:
        """Score the side of a hand from its landmarks, -1 right to 1 left; `right`: probability of the landmark model."""
        arm = self.arm_enters(points_px, width_px, height_px)
        return float(np.clip(ARM * arm + (FACING_HAND if self.facing else EGO_HAND) * (1 - 2 * right), -1, 1))


def hand_segments(p: np.ndarray, left: np.ndarray, right: np.ndarray, speed_px: np.ndarray, least_px: float, least_part: float,
             prior: SidePrior) -> list[Segment]:  # fmt: skip
    """Find the segments of hands in one sampled frame.

    Touching hands are split where the side changes, if both sides are certain and each is at least `least_part` of both.
    p: (h, w) probability of a hand; left, right: (h, w) of each side; speed_px: (h, w) speed relative to the background.
    """
    weight = (p - 0.5) * (RESTING + (1 - RESTING) * np.minimum(speed_px / PACE_PX, 1))
    side_score = _side_score(left, right)
    found: list[Segment] = []
    for part in components(p > 0.5, least_px):
        halves = [part & (side_score > 0), part & (side_score <= 0)]
        two = all(half.sum() >= least_part * part.sum() and abs(side_score[half].mean()) >= SURE for half in halves)
        for one in map(_largest, halves) if two else [part]:
            if one.sum() >= least_px:
                side = float(side_score[one].mean()) + prior.entry * prior.enters(one)
                found.append(Segment(one, side, float(weight[one].sum())))
    return found


def _side_score(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Side score (h, w) float32 from -1, right, to 1, left."""
    less, more = (cv2.GaussianBlur(one.astype(np.float32), (0, 0), BLUR_PX) for one in (left - right, left + right))
    return less / np.maximum(more, 1e-3)


def _largest(mask: np.ndarray) -> np.ndarray:
    return max(components(mask, 1), key=np.count_nonzero, default=mask)


def drop_small_tracks(tracks: Sequence[Track], least: dict[int, int], share: float) -> list[Track]:
    """Drop tracks that are seen too rarely, or are much smaller than the hands of this clip.

    least: least times seen, by first sampled frame. share: least size, relative to the median size of the largest hand.
    """
    often = [track for track in tracks if track.times_seen >= least[min(track.segments)]]
    largest: dict[int, int] = {}
    for track in often:
        for k, segment in track.segments.items():
            largest[k] = max(largest.get(k, 0), int(segment.mask.sum()))
    size = float(np.median(list(largest.values()))) if largest else 0.0
    return [track for track in often if track.largest_px >= share * size]


def assign_sides(tracks: Sequence[Track], prior: SidePrior, near_px: float) -> dict[Hand, list[Track]]:
    """Assign a side to every track by votes of all its segments, tracks with most evidence and certainty first.

    A track whose side is occupied is another segment of the same hand where both are near and certain. Else it gets the other side
    where that is free. A third hand at a time is dropped there.
    """
    side_scores = [float(np.clip(np.mean(_votes(track, tracks, prior.sign * prior.order)), -1, 1)) for track in tracks]
    bids = [(-track.evidence * (1 + sign * side_scores[i]) / 2, i, side) for i, track in enumerate(tracks)
            for side, sign in zip(SIDES, (1, -1), strict=True)]  # fmt: skip
    out: dict[Hand, list[Track]] = {side: [] for side in SIDES}
    placed = set[int]()
    for _, i, side in sorted(bids):
        alike = (side_scores[i] > 0) == (side == SIDES[0])
        free = not _overlaps_in_time(tracks[i], out[side]) or (alike and _same_hand(tracks[i], out[side], near_px))
        if i not in placed and free:
            out[side].append(tracks[i])
            placed.add(i)
    for i, track in enumerate(tracks):
        side = SIDES[0] if side_scores[i] > 0 else SIDES[1]
        if i not in placed and (segments := _free_segments(track, out[side])):
            out[side].append(Track(segments))
    return out


def _votes(track: Track, others: Sequence[Track], order: float) -> list[float]:
    """Side scores of all detections of a track, with the prior on the order of hands."""
    return [segment.side_score + order * sum(_left_of(segment, other.segments[k]) for other in others
                                     if other is not track and k in other.segments and other.segments[k].seen)
            for k, segment in track.segments.items() if segment.seen]  # fmt: skip


def _left_of(segment: Segment, other: Segment) -> float:
    """1 if a segment is to the left of another, -1 to the right."""
    x, y = (np.flatnonzero(one.mask.any(0)).mean() for one in (segment, other))
    return float(np.sign(y - x))


def _free_segments(track: Track, others: Sequence[Track]) -> dict[int, Segment]:
    """Segments of a track in the sampled frames without `others`."""
    return {k: segment for k, segment in track.segments.items() if not any(k in other.segments for other in others)}


def _overlaps_in_time(track: Track, others: Sequence[Track]) -> bool:
    return any(track.segments.keys() & other.segments.keys() for other in others)


def _same_hand(track: Track, others: Sequence[Track], near_px: float) -> bool:
    """Test for another segment of the hand of `others`: near it, and certain of the same side, in all common frames."""
    met = [(track.segments[k], other.segments[k]) for other in others for k in track.segments.keys() & other.segments.keys()]
    seen = [(a, b) for a, b in met if a.seen and b.seen]
    certain = bool(seen) and all(_both_certain(a, b) for a, b in seen)
    return certain and all(_distance_px(a.mask, b.mask) <= near_px for a, b in seen)


def _both_certain(a: Segment, b: Segment) -> bool:
    return a.side_score * b.side_score > 0 and min(abs(a.side_score), abs(b.side_score)) >= SURE


def _distance_px(a: np.ndarray, b: np.ndarray) -> float:
    """Shortest distance between two masks, px."""
    return float(cv2.distanceTransform((~a).astype(np.uint8), cv2.DIST_L2, 3)[b].min())
