"""Fusion of landmarks and hand finder: masks of the two hands over time, with their side and their landmarks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from afford.common.masks import dilate
from afford.extraction.hands import LEFT, RIGHT, SLEEVE, Detection
from afford.extraction.hands.colours import BLUR_PX, MAX_ODDS
from afford.extraction.hands.evidence import regions
from afford.extraction.hands.hand_masks import MaskedTrack, hand_masks
from afford.extraction.hands.landmark_tracks import HandPoints, landmark_tracks
from afford.extraction.hands.motion import SampledFrames, residual_speed
from afford.extraction.hands.object_evidence import HandMasks
from afford.extraction.hands.part_tracks import Segment, Track, link_segments
from afford.extraction.hands.refine import colour_bins, guided_filter, refine_by_colour
from afford.extraction.hands.sides import SidePrior, assign_sides, drop_small_tracks, hand_segments
from schemas.hands import HandLandmarks
from schemas.video import SIDES, Hand

LEAST_LIKE = 0.35
"""least size of a hand with landmarks, relative to the hand with most evidence"""
FOUND_NEAR_PX = 5
"""regions of the hand finder nearer than this to a hand with landmarks belong to it"""


@dataclass(frozen=True, eq=False)
class FoundHands:
    """The two hands over time."""

    masks: HandMasks
    points: dict[Hand, dict[int, HandPoints]]
    """side -> sampled frame -> landmarks, where there are any"""


def find_hands(sampled: SampledFrames, landmarks: HandLandmarks | None, seen: np.ndarray | None, params: Detection) -> FoundHands:
    """Find the hands. `seen`: smoothed probabilities (k, h, w, 4) of the hand finder, or None."""
    prior = SidePrior(params.viewpoint == "facing", params.order, params.entry)
    height, width = sampled.rgb.shape[1:3]
    masked = _with_landmarks(sampled, landmarks, seen, params) if landmarks is not None else []
    tracks = [_track(one, prior, width, height) for one in masked]
    if seen is not None:
        tracks += _found_alone(seen, sampled, masked, prior, params)
    chosen = assign_sides([track for track in tracks if track.segments], prior, params.near * width)
    points = {side: _points(chosen[side], masked) for side in SIDES}
    return FoundHands({side: _union(chosen[side]) for side in SIDES}, points)


def _with_landmarks(
    sampled: SampledFrames, landmarks: HandLandmarks, seen: np.ndarray | None, params: Detection
) -> list[MaskedTrack]:
    """Segment the hands with landmarks: in each sampled frame at most two, those with most evidence over time.

    What is left of a third hand in frames without landmarks is dropped.
    """
    tracks = landmark_tracks(landmarks, sampled.rgb.shape[2], sampled.runs, params.least_evidence, params.least_presence)
    if tracks:
        size = max(tracks, key=lambda track: track.evidence * track.size_px).size_px
        tracks = [track for track in tracks if track.size_px >= LEAST_LIKE * size]
    extra = None if seen is None else _finder_odds(seen, params.trust)
    masked = hand_masks(tracks, sampled, extra, params.least_contrast)
    for k in range(len(sampled.at)):
        for one in [one for one in masked if k in one.masks][len(SIDES) :]:
            del one.masks[k]
    return [one for one in masked if one.masks.keys() & one.track.found.keys()]


def _finder_odds(seen: np.ndarray, trust: float) -> np.ndarray:
    p = np.clip((seen[..., LEFT] + seen[..., RIGHT]).astype(np.float32) * (1 - seen[..., SLEEVE]), 0.05, 0.95)
    return (trust * np.log(p / (1 - p))).astype(np.float16)


def _track(one: MaskedTrack, prior: SidePrior, width: int, height: int) -> Track:
    """Convert a hand with landmarks to a track of segments; where it is followed without landmarks, its side has no vote."""
    segments = {}
    for k, mask in one.masks.items():
        found = one.track.found.get(k)
        score = prior.landmark_score(found.points_px, found.right, width, height) if found else 0.0
        evidence = float(mask.sum()) * found.presence if found else 0.0
        segments[k] = Segment(mask, score, evidence, seen=found is not None)
    return Track(segments)


def _found_alone(
    seen: np.ndarray, sampled: SampledFrames, masked: Sequence[MaskedTrack], prior: SidePrior, params: Detection
) -> list[Track]:
    """Find the hands that only the hand finder detects, in regions whose evidence is that of a hand."""
    left, right = (seen[..., side] * (1 - seen[..., SLEEVE]) for side in (LEFT, RIGHT))
    likely = refine_by_colour(np.minimum(left + right, 1), sampled.rgb, params.colour)
    least_px = params.least_hand * sampled.rgb.shape[1] * sampled.rgb.shape[2]
    found = []
    for k in range(len(sampled.at)):
        taken = [one.masks[k] for one in masked if k in one.masks]
        free = ~dilate(np.any(taken, axis=0), FOUND_NEAR_PX) if taken else np.ones(likely[k].shape, bool)
        colour = _hand_colours(masked, sampled.rgb[k])
        hands = [one.mask for one in regions(seen[k].astype(np.float32) * free[..., None], sampled.rgb[k], colour)
                 if one.probability >= params.least_found]  # fmt: skip
        p = np.zeros(free.shape, np.float32)
        if hands:
            p = guided_filter(likely[k], sampled.rgb[k], params.edge_px) * (dilate(np.any(hands, axis=0), FOUND_NEAR_PX) & free)
        found.append(hand_segments(p, left[k].astype(np.float32), right[k].astype(np.float32), residual_speed(sampled, k), least_px,
                                   params.least_part, prior))  # fmt: skip
    leap_px = params.leap * sampled.rgb.shape[2]
    tracks = link_segments(found, sampled, params.link_min_iou, params.gap_looks, leap_px=leap_px)
    return drop_small_tracks(tracks, min_times_seen(sampled, params.least_looks), params.least_like)


def _hand_colours(masked: Sequence[MaskedTrack], rgb: np.ndarray) -> np.ndarray | None:
    """Agreement (h, w) from -1 to 1 with the colours of the hands with landmarks; None without any."""
    if not masked:
        return None
    bins = colour_bins(rgb, BLUR_PX)
    return np.asarray(np.max([one.odds[bins] for one in masked], axis=0) / MAX_ODDS)


def min_times_seen(sampled: SampledFrames, count: int) -> dict[int, int]:
    """Least number of detections of a track by its first sampled frame: `count`, or the length of a shorter run."""
    return {k: min(count, len(run)) for run in sampled.runs for k in run}


def _points(tracks: Sequence[Track], masked: Sequence[MaskedTrack]) -> dict[int, HandPoints]:
    """Landmarks of the hands whose masks these tracks have, by sampled frame."""
    out = {}
    for track in tracks:
        for k, segment in track.segments.items():
            for one in masked:
                if k in one.track.found and one.masks.get(k) is segment.mask:
                    out[k] = one.track.found[k]
    return out


def _union(tracks: Sequence[Track]) -> dict[int, np.ndarray]:
    sampled = sorted({k for track in tracks for k in track.segments})
    return {k: np.any([track.segments[k].mask for track in tracks if k in track.segments], axis=0) for k in sampled}
