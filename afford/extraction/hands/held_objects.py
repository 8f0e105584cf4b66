"""Touched objects as tracks, and the contact of each hand and finger: what is neither background nor hand, where hands grip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.masks import dilate, erode
from afford.extraction.hands.grip import Keypoints, finger_contact, grip_ring
from afford.extraction.hands.held_evidence import HeldEvidence
from afford.extraction.hands.motion import SampledFrames, same_colour
from afford.extraction.hands.object_evidence import EvidenceModel, HandMasks, all_hands, object_odds
from afford.extraction.hands.part_tracks import Segment, Track, link_segments
from afford.extraction.hands.refine import components, segment_grabcut
from schemas.video import SIDES, Hand

NOTHING = -1
LIKELY = 3.0
"""mean log odds from which a piece apart from the hand may belong to its object"""
PIECE_PX, JOIN_PX, OPENING_PX, CLOSING_PX = 30, 10, 3, 5
"""least area of a piece; largest gap between pieces of an object; narrower bridges are cut, and narrower gaps are closed"""
LEAST_OVERLAP_PX, SHARE = 8, 0.15
"""least overlap of a piece with the surroundings of a hand, and its share of the largest overlap with any hand"""
ARM_PX, SLEEVE = 3, 1.0
"""a piece is part of a sleeve when it borders on a forearm, within this distance, by this share of its overlap with the grip"""
HOLE = 0.5
"""holes are filled up to this share of the area of the object"""
LARGEST = 0.35
"""largest object, as a share of the picture"""
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
) -> TouchedObjects:
    """Find the objects that hands touch, from motion and background; `touched`, `sleeve` and `network` as in `object_odds`."""
    odds, arms = object_odds(sampled, hands, keypoints, evidence, touched, sleeve, network)
    held = [_held(sampled, k, odds[k], arms[k], hands, keypoints, evidence, model) for k in range(len(sampled.at))]
    touch = {side: touch_probability(network, side, sampled.runs) for side in SIDES} if network is not None else {}
    held = [{side: mask for side, mask in one.items() if side not in touch or touch[side][k] >= model.least_touch}
            for k, one in enumerate(held)]  # fmt: skip
    tracks = link_segments([_distinct(list(one.values())) for one in held], sampled, model.min_iou, model.rest, rests=True)
    least = {k: min(model.least, len(run)) for run in sampled.runs for k in run}
    kept = [track for track in tracks if track.times_seen >= least[min(track.segments)]]
    contact = contacts(kept, held, hands, model.least)
    objects = [_backwards(track, sampled, model.rest) for track in kept]
    fingers = {side: _finger_contacts(side, objects, contact[side], keypoints) for side in SIDES}
    return TouchedObjects(objects, contact, fingers, tuple(_reasons(tracks, kept, sampled)))


def touch_probability(network: Sequence[HeldEvidence], side: Hand, runs: Sequence[range]) -> np.ndarray:
    """Mean probability (k,) of a touch over the neighbouring sampled frames that show the hand; 0 where it is not visible."""
    out = np.zeros(len(network))
    for run in runs:
        for k in run:
            near = [network[j].touch[side] for j in range(max(k - AROUND, run.start), min(k + AROUND + 1, run.stop))
                    if side in network[j].touch]  # fmt: skip
            out[k] = np.mean(near) if side in network[k].touch else 0.0
    return out


def _held(
    sampled: SampledFrames, k: int, odds: np.ndarray, arms: np.ndarray, hands: HandMasks, keypoints: Keypoints,
    evidence: EvidenceModel, model: ContactModel,
) -> dict[Hand, np.ndarray]:
    """Segment what each hand holds in sampled frame k: side -> mask (h, w) bool; sides without an object are missing."""
    skin = all_hands(hands, k, odds.shape)
    if not skin.any():
        return {}
    far = cv2.distanceTransform((~skin).astype(np.uint8), cv2.DIST_L2, 3) > evidence.far_px
    rings = {side: grip_ring(hands[side][k], keypoints[side].at(k) if side in keypoints else None, model.ring_px)
             for side in SIDES if k in hands[side]}  # fmt: skip
    foreground = segment_grabcut(odds, sampled.rgb[k], skin | arms | far)
    free = _without_sleeves(foreground, arms, np.any(list(rings.values()), axis=0), sampled.rgb[k])
    pieces = [piece for piece in components(free, PIECE_PX, OPENING_PX) if not _sleeve(piece, arms, rings)]
    overlap = [{side: int((ring & piece).sum()) for side, ring in rings.items()} for piece in pieces]
    apart = [piece for piece, at in zip(pieces, overlap, strict=True)
             if max(at.values()) < LEAST_OVERLAP_PX and odds[piece].mean() > LIKELY]  # fmt: skip
    out = {}
    for side in rings:
        mine = [piece for piece, at in zip(pieces, overlap, strict=True)
                if at[side] >= max(LEAST_OVERLAP_PX, SHARE * max(at.values()))]  # fmt: skip
        if mine:
            joined = _joined(mine, apart)
            closed = erode(dilate(joined, CLOSING_PX), CLOSING_PX) & ~skin & ~arms
            whole = fill_holes(joined | closed, skin)
            if model.least_px <= whole.sum() <= LARGEST * whole.size:
                out[side] = whole
    return out


def _without_sleeves(foreground: np.ndarray, arms: np.ndarray, ring: np.ndarray, rgb: np.ndarray) -> np.ndarray:
    """Remove the parts of the foreground (h, w) bool that belong to forearms rather than to the grip, by watershed."""
    grip, arm = foreground & ring & ~dilate(arms, ARM_PX), arms & dilate(foreground, ARM_PX)
    if not (grip.any() and arm.any()):
        return foreground
    markers = np.ones(foreground.shape, np.int32)
    markers[foreground] = 0
    markers[arm], markers[grip] = 2, 3
    flooded = cv2.watershed(np.ascontiguousarray(rgb), markers)
    return foreground & (flooded != 2)


def _sleeve(piece: np.ndarray, arms: np.ndarray, rings: Mapping[Hand, np.ndarray]) -> bool:
    """Test whether a piece borders on a forearm more than on the surroundings of the fingers."""
    beside = int((dilate(piece, ARM_PX) & arms).sum())
    return beside > SLEEVE * max(int((ring & piece).sum()) for ring in rings.values())


def _joined(mine: Sequence[np.ndarray], apart: Sequence[np.ndarray]) -> np.ndarray:
    """Join the pieces at a hand with near ones beyond it: fingers hide what connects them."""
    whole: np.ndarray = np.any(mine, axis=0)
    for piece in apart:
        if (dilate(piece, JOIN_PX) & whole).any():
            whole = whole | piece
    return whole


def fill_holes(mask: np.ndarray, hand: np.ndarray) -> np.ndarray:
    """Fill the holes of an object (h, w) bool that it encloses alone or with the hand; the hand itself is not filled."""
    count, label, stats, _ = cv2.connectedComponentsWithStats((~(mask | hand)).astype(np.uint8), connectivity=4)
    outside = set(np.concatenate([label[0], label[-1], label[:, 0], label[:, -1]]).tolist())
    holes = [i for i in range(1, count) if i not in outside and stats[i, cv2.CC_STAT_AREA] < HOLE * mask.sum()]
    return mask | np.isin(label, holes)


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


def _reasons(tracks: Sequence[Track], kept: Sequence[Track], sampled: SampledFrames) -> list[str]:
    dropped = sorted(min(track.segments) for track in tracks if not any(track is other for other in kept))
    if not dropped:
        return []
    times = ", ".join(f"{sampled.time_s[k]:.1f}" for k in dropped[:5]) + (" ..." if len(dropped) > 5 else "")
    return [f"something moves with a hand near {times} s, but for too short a time to be outlined as an object"]
