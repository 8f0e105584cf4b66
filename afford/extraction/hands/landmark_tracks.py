"""Tracks of hands from the landmarks of single frames: linked over time, joined across gaps, and dropped without evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from afford.extraction.landmarks.geometry import hand_size, palm_centre
from schemas.hands import HandLandmarks

GAP = 5
"""sampled frames without landmarks within one track"""
LINK, LINK_GROWTH = 1.0, 0.15
"""largest distance between detections of one track, in sizes of the hand, and its growth with every sampled frame of a gap"""
LONG_GAP = 60
"""sampled frames after which a hand that was lost may continue a track, near the place where it was lost"""
REJOIN, REJOIN_GROWTH, REJOIN_MOST = 1.0, 0.1, 2.0
SIZE_RATIO = 0.4
"""least ratio of the sizes of a hand in two frames of one track"""
SAME, SAME_CENTRE, SAME_HULL = 0.7, 0.5, 0.5
"""two detections are one hand when their keypoints or their centres are nearer than this, in sizes of the hand, or when the hulls
of their keypoints overlap by more than this share"""


@dataclass(frozen=True, eq=False)
class HandPoints:
    """Landmarks of one hand in one sampled frame, at working size."""

    points_px: np.ndarray
    """(21, 2)"""
    points_m: np.ndarray
    """(21, 3) at the size of the model's hand"""
    presence: float
    right: float


@dataclass
class LandmarkTrack:
    """Landmarks of one hand over time."""

    found: dict[int, HandPoints] = field(default_factory=dict)
    """sampled frame -> landmarks"""

    @property
    def evidence(self) -> float:
        """Sum of the presence in all frames."""
        return sum(one.presence for one in self.found.values())

    @property
    def size_px(self) -> float:
        """Median size of the hand."""
        return float(np.median([hand_size(one.points_px) for one in self.found.values()]))

    @property
    def certainty(self) -> float:
        """Largest presence in any frame."""
        return max(one.presence for one in self.found.values())


def landmark_tracks(
    landmarks: HandLandmarks, width_px: int, runs: Sequence[range], min_evidence: float, min_certainty: float
) -> list[LandmarkTrack]:
    """Link the landmarks of all sampled frames to tracks, those with most evidence first.

    width_px: working width, to which keypoints are scaled. runs: sampled frames without a gap of the video. A track in a run of few
    frames needs its certainty alone.
    """
    here = _by_frame(landmarks, width_px)
    kept = list[LandmarkTrack]()
    for run in runs:
        enough = min(min_evidence, 0.6 * len(run))
        tracks = _joined(_linked(here, run))
        kept += [track for track in tracks if track.evidence >= enough and track.certainty >= min_certainty]
    return sorted(kept, key=lambda track: -track.evidence)


def _by_frame(landmarks: HandLandmarks, width_px: int) -> list[list[HandPoints]]:
    """Landmarks of every sampled frame without repetitions of one hand, most certain first."""
    scale = width_px / landmarks.width_px
    out: list[list[HandPoints]] = [[] for _ in landmarks.frame]
    for n in np.argsort(-landmarks.presence, kind="stable").tolist():
        one = HandPoints(landmarks.keypoints_px[n].astype(np.float64) * scale, landmarks.keypoints_m[n].astype(np.float64),
                         float(landmarks.presence[n]), float(landmarks.right[n]))  # fmt: skip
        others = out[int(landmarks.index[n])]
        if not any(_same_hand(one, other) for other in others):
            others.append(one)
    return out


def _same_hand(one: HandPoints, other: HandPoints) -> bool:
    size = max(hand_size(one.points_px), hand_size(other.points_px))
    near = np.linalg.norm(one.points_px - other.points_px, axis=1).mean() < SAME * size
    central = np.linalg.norm(palm_centre(one.points_px) - palm_centre(other.points_px)) < SAME_CENTRE * size
    return bool(near or central or hull_overlap(one.points_px, other.points_px) > SAME_HULL)


def hull_overlap(one_px: np.ndarray, other_px: np.ndarray) -> float:
    """Share of the smaller of the convex hulls of two sets of keypoints (21, 2) that lies in the other."""
    hulls = [cv2.convexHull(points.astype(np.float32)) for points in (one_px, other_px)]
    common, _ = cv2.intersectConvexConvex(*hulls)
    return float(common / max(min(cv2.contourArea(hull) for hull in hulls), 1e-6))


def _linked(here: Sequence[Sequence[HandPoints]], run: range) -> list[LandmarkTrack]:
    """Link the landmarks of consecutive sampled frames, as they moved or with the speed of the last two."""
    tracks = list[LandmarkTrack]()
    for k in run:
        live = [track for track in tracks if k - max(track.found) <= GAP]
        costs = np.array([[_link_cost(track, one, k) for one in here[k]] for track in live]).reshape(len(live), len(here[k]))
        taken = set[int]()
        for i, j in zip(*linear_sum_assignment(np.minimum(costs, 1e3)), strict=True):
            if costs[i, j] < LINK:
                live[i].found[k] = here[k][j]
                taken.add(int(j))
        tracks += [LandmarkTrack({k: one}) for j, one in enumerate(here[k]) if j not in taken]
    return tracks


def _link_cost(track: LandmarkTrack, one: HandPoints, k: int) -> float:
    """Distance from the predicted place of a track, in sizes of the hand."""
    last = max(track.found)
    before, gap = track.found[last], k - last
    sizes = sorted((hand_size(before.points_px), hand_size(one.points_px)))
    if sizes[0] < SIZE_RATIO * sizes[1]:
        return np.inf
    moved = palm_centre(one.points_px) - palm_centre(before.points_px)
    speed = np.zeros(2)
    if last - 1 in track.found:
        speed = palm_centre(before.points_px) - palm_centre(track.found[last - 1].points_px)
    apart = min(float(np.linalg.norm(moved)), float(np.linalg.norm(moved - gap * speed)))
    return apart / sizes[1] / (1 + LINK_GROWTH * (gap - 1))


def _joined(tracks: Sequence[LandmarkTrack]) -> list[LandmarkTrack]:
    """Join tracks of one hand that was not detected in between, nearest first."""
    out = sorted(tracks, key=lambda track: min(track.found))
    while True:
        costs = [(_join_cost(a, b), i, j) for i, a in enumerate(out) for j, b in enumerate(out) if i != j]
        cost, i, j = min(costs, default=(np.inf, 0, 0))
        if cost >= REJOIN:
            return out
        out[i].found.update(out[j].found)
        del out[j]


def _join_cost(a: LandmarkTrack, b: LandmarkTrack) -> float:
    """Distance between the end of one track and the start of a later one, in sizes of the hand."""
    end, start = max(a.found), min(b.found)
    if not 0 < start - end <= LONG_GAP:
        return np.inf
    one, other = a.found[end].points_px, b.found[start].points_px
    sizes = sorted((hand_size(one), hand_size(other)))
    if sizes[0] < SIZE_RATIO * sizes[1]:
        return np.inf
    apart = float(np.linalg.norm(palm_centre(one) - palm_centre(other)))
    return apart / sizes[1] / min(1 + REJOIN_GROWTH * (start - end), REJOIN_MOST)
