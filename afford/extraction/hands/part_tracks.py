"""Tracks of segments: link segments of consecutive sampled frames by motion and overlap, across short gaps as well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from afford.common.masks import iou
from afford.extraction.hands.motion import SampledFrames

MIN_SIZE_RATIO = 0.2
"""least ratio of the sizes of a segment in two consecutive sampled frames"""
MIN_COVERED, MIN_MERGED_RATIO = 0.6, 0.5
"""a segment merges two tracks when it covers this share of both, and the ratio of their sizes is at least the second value"""


@dataclass(frozen=True)
class Segment:
    """One segment of one sampled frame."""

    mask: np.ndarray
    """(h, w) bool"""
    side_score: float = 0.0
    """hands: from -1, certainly right, to 1, certainly left"""
    evidence: float = 0.0
    """hands: sum over pixels of the probability above one half; resting pixels have a lower weight than moving ones"""
    seen: bool = True
    """False where the segment is only propagated by motion"""


@dataclass
class Track:
    """A hand or an object over time."""

    segments: dict[int, Segment] = field(default_factory=dict)
    """sampled frame -> segment"""

    @property
    def times_seen(self) -> int:
        """Number of sampled frames in which it is detected."""
        return sum(segment.seen for segment in self.segments.values())

    @property
    def evidence(self) -> float:
        """Total evidence for a hand."""
        return sum(segment.evidence for segment in self.segments.values())

    @property
    def largest_px(self) -> int:
        """Largest area in pixels."""
        return max(int(segment.mask.sum()) for segment in self.segments.values())


def link_segments(found: Sequence[Sequence[Segment]], sampled: SampledFrames, min_iou: float, gap: int, rests: bool = False,
           leap_px: float = 0.0) -> list[Track]:  # fmt: skip
    """Link the segments of all sampled frames to tracks.

    A segment continues the track that overlaps it most after motion, by at least `min_iou`. A track without a segment is propagated
    for up to `gap` sampled frames. It ends where it was last seen, or, with `rests`, where propagation ends.

    leap_px: for hands, which may move faster than optical flow: a segment of similar size within this distance also continues a
    track, and a segment that merges two tracks is split by distance. 0 turns both off.
    """
    done: list[Track] = []
    for run in sampled.runs:
        live: list[Track] = []
        for k in run:
            waiting = [track for track in live if k - _last_seen(track) <= gap + 1]
            _propagate(waiting, sampled, k)
            parts = _split_merged(waiting, found[k], k) if leap_px else found[k]
            new = [Track({k: segment}) for segment in _match_segments(waiting, parts, k, min_iou, leap_px)]
            done += new
            live = [track for track in (*waiting, *new) if k in track.segments]
    return done if rests else [_trim(track) for track in done]


def _last_seen(track: Track) -> int:
    return max(k for k, segment in track.segments.items() if segment.seen)


def _propagate(tracks: Sequence[Track], sampled: SampledFrames, k: int) -> None:
    """Propagate every track to sampled frame k by motion; a track that leaves the picture ends."""
    for track in tracks:
        last = track.segments[k - 1]
        moved = sampled.warp(last.mask.astype(np.float32), k, 1)
        if moved is not None and (moved > 0.5).any():
            track.segments[k] = Segment(moved > 0.5, seen=False)


def _match_segments(tracks: Sequence[Track], found: Sequence[Segment], k: int, min_iou: float, leap_px: float) -> list[Segment]:
    """Assign the segments of sampled frame k to tracks; returns the unassigned segments."""
    here = [track for track in tracks if k in track.segments]
    masks = [track.segments[k].mask for track in here]
    scores = np.array([[_match_score(mask, segment.mask, min_iou, leap_px) for segment in found] for mask in masks])
    scores = scores.reshape(len(here), len(found))
    matched = set()
    for i, j in zip(*linear_sum_assignment(-scores), strict=True):
        if scores[i, j] > 0:
            here[i].segments[k] = found[j]
            matched.add(j)
    return [segment for j, segment in enumerate(found) if j not in matched]


def _match_score(here: np.ndarray, part: np.ndarray, min_iou: float, leap_px: float) -> float:
    """Score a match: 1 + IoU for enough overlap, below 1 by distance for a similar size, 0 for no match."""
    overlap = iou(here, part)
    if overlap >= min_iou or not leap_px:
        return 1 + overlap if overlap >= min_iou else 0.0
    sizes = sorted((int(here.sum()), int(part.sum())))
    apart_px = np.hypot(*(_centroid(here) - _centroid(part)))
    return max(0.0, 1 - float(apart_px) / leap_px) if sizes[0] >= MIN_SIZE_RATIO * sizes[1] else 0.0


def _centroid(mask: np.ndarray) -> np.ndarray:
    return np.array([at.mean() for at in np.nonzero(mask)])


def _split_merged(tracks: Sequence[Track], found: Sequence[Segment], k: int) -> list[Segment]:
    """Split each segment of sampled frame k that merges two tracks of similar size; the halves have a neutral side score."""
    out = list[Segment]()
    for segment in found:
        inside = [one for track in tracks if k in track.segments and _contained(one := track.segments[k].mask, segment.mask)]
        sizes = sorted(int(one.sum()) for one in inside)
        if len(inside) != 2 or sizes[0] < MIN_MERGED_RATIO * sizes[1]:
            out.append(segment)
            continue
        away = [cv2.distanceTransform((~one).astype(np.uint8), cv2.DIST_L2, 3) for one in inside]
        halves = (segment.mask & (away[0] <= away[1]), segment.mask & (away[0] > away[1]))
        for half in halves:
            evidence = segment.evidence * half.sum() / segment.mask.sum()
            out.append(replace(segment, mask=half, side_score=0.0, evidence=evidence))
    return out


def _contained(one: np.ndarray, part: np.ndarray) -> bool:
    return bool(one.any() and (one & part).sum() >= MIN_COVERED * one.sum())


def _trim(track: Track) -> Track:
    last = _last_seen(track)
    return Track({k: segment for k, segment in track.segments.items() if k <= last})
