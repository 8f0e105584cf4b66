"""Touched objects as tracks, and the contact of each hand and finger: what is neither background nor hand, where hands grip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from afford.extraction.hands.grip import Keypoints, finger_contact
from afford.extraction.hands.held_evidence import HeldEvidence
from afford.extraction.hands.motion import SampledFrames, same_colour
from afford.extraction.hands.moving_objects import moving_objects
from afford.extraction.hands.object_evidence import EvidenceModel, HandMasks, object_odds
from afford.extraction.hands.part_tracks import Segment, Track, link_segments
from afford.extraction.hands.touch_paths import PathModel
from afford.extraction.hands.touched_outlines import HandEvidence, touched_outlines
from afford.extraction.prompted import Segmenter
from schemas.video import SIDES, Hand

NOTHING = -1
AROUND = 2
"""sampled frames before and after over which the probability of a touch is averaged"""
SAME_MASK = 0.8
"""IoU from which the things at both hands are one object"""


@dataclass(frozen=True)
class ContactModel:
    """Sizes, distances and times of the detection of touched objects, in pixels and sampled frames."""

    ring_px: int
    """a hand dilated by this much touches the objects it overlaps"""
    least_px: float
    """smallest area of an object"""
    min_iou: float
    """least IoU that links segments of consecutive sampled frames"""
    rest: int
    """sampled frames for which an object is followed before and after the touch"""
    least: int
    """sampled frames in which an object and a contact must be seen to count"""
    path: PathModel
    """choice among the outlines of promptable segmentation"""
    segment_s: float
    """seconds between two frames that are segmented"""
    least_touch: float = 0.57
    """least probability of a touch, from the network of held objects where there is one"""


@dataclass(frozen=True)
class TouchedObjects:
    """Touched objects of a clip and the contact of its hands."""

    objects: list[Track]
    contact: dict[Hand, np.ndarray]
    """side -> (k,) int64: index of the touched object in each sampled frame, NOTHING without contact or hand"""
    fingers: dict[Hand, np.ndarray]
    """side -> (k, 5) float32: probability of contact of thumb to little finger, 0 where unknown"""
    reasons: tuple[str, ...]
    """one sentence for each touch that is left out"""


def touched_objects(
    sampled: SampledFrames, hands: HandMasks, keypoints: Keypoints, evidence: EvidenceModel, model: ContactModel,
    touched: np.ndarray | None = None, sleeve: np.ndarray | None = None, network: Sequence[HeldEvidence] | None = None,
    segment: Segmenter | None = None,
) -> TouchedObjects:
    """Find the objects that hands touch, by promptable segmentation where `segment` is given, else from motion and background.

    `touched`, `sleeve` and `network` as in `object_odds`.
    """
    odds, arms = object_odds(sampled, hands, keypoints, evidence, touched, sleeve, network)
    unsure: list[int] = []
    if segment is not None:
        around = HandEvidence(hands, keypoints, odds, arms, evidence.far_px)
        held, unsure = touched_outlines(sampled, around, segment, model.segment_s, model.path)
    else:
        held = [moving_objects(sampled, k, odds[k], arms[k], hands, keypoints, evidence, model.ring_px, model.least_px)
                for k in range(len(sampled.at))]  # fmt: skip
    held = held if network is None else _gated(held, network, sampled.runs, model.least_touch)
    tracks = link_segments([_distinct(list(one.values())) for one in held], sampled, model.min_iou, model.rest, rests=True)
    least = {k: min(model.least, len(run)) for run in sampled.runs for k in run}
    kept = [track for track in tracks if track.times_seen >= least[min(track.segments)]]
    contact = contacts(kept, held, hands, model.least)
    objects = [_backwards(track, sampled, model.rest) for track in kept]
    fingers = {side: _finger_contacts(side, objects, contact[side], keypoints) for side in SIDES}
    return TouchedObjects(objects, contact, fingers, tuple(_reasons(tracks, kept, sampled, unsure)))


def _gated(held: Sequence[Mapping[Hand, np.ndarray]], network: Sequence[HeldEvidence], runs: Sequence[range],
           least_touch: float) -> list[dict[Hand, np.ndarray]]:  # fmt: skip
    """Keep the objects of hands that touch something, by the network of held objects."""
    touch = {side: touch_probability(network, side, runs) for side in SIDES}
    return [{side: mask for side, mask in one.items() if touch[side][k] >= least_touch} for k, one in enumerate(held)]


def touch_probability(network: Sequence[HeldEvidence], side: Hand, runs: Sequence[range]) -> np.ndarray:
    """Mean probability (k,) of a touch over the neighbouring sampled frames that show the hand; 0 where it is not visible."""
    out = np.zeros(len(network))
    for run in runs:
        for k in run:
            near = [network[j].touch[side] for j in range(max(k - AROUND, run.start), min(k + AROUND + 1, run.stop))
                    if side in network[j].touch]  # fmt: skip
            out[k] = np.mean(near) if side in network[k].touch else 0.0
    return out


def _distinct(masks: Sequence[np.ndarray]) -> list[Segment]:
    """One segment for each object; what both hands hold is one object."""
    if len(masks) == 2 and (masks[0] & masks[1]).sum() >= SAME_MASK * min(mask.sum() for mask in masks):
        return [Segment(masks[0] | masks[1])]
    return [Segment(mask) for mask in masks]


def contacts(
    objects: Sequence[Track], held: Sequence[Mapping[Hand, np.ndarray]], hands: HandMasks, least: int
) -> dict[Hand, np.ndarray]:
    """Find the contact of each side: index of the touched object in each sampled frame, NOTHING without contact or hand.

    A contact of fewer than `least` sampled frames in a row is dropped, unless the hand itself is visible for no longer.
    """
    touch = {side: [_touched_object(objects, one.get(side), k) for k, one in enumerate(held)] for side in SIDES}
    return {side: _drop_short_contacts(touch[side], hands[side], least) for side in SIDES}


def _touched_object(objects: Sequence[Track], mask: np.ndarray | None, k: int) -> int:
    if mask is None:
        return NOTHING
    overlap = [int((mask & one.segments[k].mask).sum()) if k in one.segments else 0 for one in objects]
    return int(np.argmax(overlap)) if any(overlap) else NOTHING


def _drop_short_contacts(touched: list[int], seen: Mapping[int, np.ndarray], least: int) -> np.ndarray:
    out, k = np.array(touched, np.int64), 0
    while k < len(touched):
        end = next((j for j in range(k, len(touched)) if touched[j] != touched[k]), len(touched))
        alone = (k == 0 or k - 1 not in seen) and (end == len(touched) or end not in seen)
        if end - k < least and not alone:
            out[k:end] = NOTHING
        k = end
    return out


def _backwards(track: Track, sampled: SampledFrames, rest: int) -> Track:
    """Follow an object by motion to the sampled frames before it was first seen, as long as colours agree."""
    segments, first = dict(track.segments), min(track.segments)
    for k in range(first - 1, max(first - 1 - rest, -1), -1):
        moved = sampled.warp(segments[k + 1].mask.astype(np.float32), k, -1)
        if moved is None or not (moved > 0.5).any() or same_colour(sampled, k, -1)[moved > 0.5].mean() < 0.5:
            break
        segments[k] = Segment(moved > 0.5, seen=False)
    return Track(segments)


def _finger_contacts(side: Hand, objects: Sequence[Track], contact: np.ndarray, keypoints: Keypoints) -> np.ndarray:
    out = np.zeros((len(contact), 5), np.float32)
    for k in np.flatnonzero(contact != NOTHING).tolist() if side in keypoints else []:
        points, thing = keypoints[side].at(k), objects[int(contact[k])].segments.get(k)
        if points is not None and thing is not None:
            out[k] = finger_contact(thing.mask, points)
    return out


def _reasons(tracks: Sequence[Track], kept: Sequence[Track], sampled: SampledFrames, unsure: Sequence[int]) -> list[str]:
    dropped = sorted(min(track.segments) for track in tracks if not any(track is other for other in kept))
    out = []
    if dropped:
        out.append(f"something moves with a hand near {_times(dropped, sampled)} s, but for too short a time to be outlined as an "
                   "object")  # fmt: skip
    if unsure:
        out.append(f"a hand may touch something near {_times(unsure, sampled)} s, but its outline is not certain; it is left out")
    return out


def _times(at: Sequence[int], sampled: SampledFrames) -> str:
    return ", ".join(f"{sampled.time_s[k]:.1f}" for k in at[:5]) + (" ..." if len(at) > 5 else "")
