"""Objects that hands touch, from the hand finder and from motion with the hand, and the contact of each hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from afford.common.masks import dilate
from afford.extraction.hands.motion import SampledFrames, comotion, propagate_odds
from afford.extraction.hands.part_tracks import Segment, Track
from afford.extraction.hands.refine import components, segment_grabcut
from schemas.video import SIDES, Hand

HandMasks = Mapping[Hand, Mapping[int, np.ndarray]]
"""side -> sampled frame -> mask (h, w) bool"""
NOTHING = -1
MIN_PROBABILITY = 0.2
"""object probabilities of the hand finder are clipped to this value and 1 minus it: it was trained on few objects"""
HALO_PX = 7
"""narrower segments are dropped: the flow of a hand extends slightly beyond its outline"""


@dataclass(frozen=True)
class ContactModel:
    """Weights and distances, in pixels, of the detection of touched objects."""

    ring_px: int
    """a hand dilated by this much touches the objects it overlaps"""
    far_px: float
    """largest distance from the hand at which motion counts"""
    least_px: float
    """smallest area of an object"""
    motion: float
    """weight of motion with the hand, against 1 for the hand finder, in log odds"""
    sleeve: float
    """log odds against an object where a sleeve is certain"""
    lasting: float
    """weight of the odds of the previous sampled frame"""


def held_objects(
    seen: np.ndarray, cloth: np.ndarray, sampled: SampledFrames, hands: HandMasks, model: ContactModel
) -> list[list[Segment]]:
    """Find the segments of objects at hands in every sampled frame.

    seen, cloth: (k, h, w) probability of a touched object, and of a sleeve, which moves with the hand as an object does.
    """
    own_hands = [[hands[side][k] for side in SIDES if k in hands[side]] for k in range(len(sampled.at))]
    own = [_object_odds(seen[k], cloth[k], sampled, k, own_hands[k], model) for k in range(len(sampled.at))]
    odds = propagate_odds(own, sampled, model.lasting)
    return [
        _object_segments(odds[k], seen[k], sampled.rgb[k], np.any(masks, axis=0), model) if masks else []
        for k, masks in enumerate(own_hands)
    ]


def _object_odds(
    p: np.ndarray, cloth: np.ndarray, sampled: SampledFrames, k: int, hands: Sequence[np.ndarray], model: ContactModel,
) -> np.ndarray:
    """Log odds (h, w) of a held object in sampled frame k, from the hand finder and from motion."""
    if not hands:
        return np.zeros(p.shape, np.float32)
    hand, sure = np.any(hands, axis=0), np.clip(p.astype(np.float32), MIN_PROBABILITY, 1 - MIN_PROBABILITY)
    along = [comotion(sampled, k, one, hand, model.far_px) for one in hands]
    return np.log(sure / (1 - sure)) + model.motion * np.sum(along, axis=0) - model.sleeve * cloth.astype(np.float32)


def _object_segments(odds: np.ndarray, p: np.ndarray, rgb: np.ndarray, hand: np.ndarray, model: ContactModel) -> list[Segment]:
    far = cv2.distanceTransform((~hand).astype(np.uint8), cv2.DIST_L2, 3) > model.far_px
    thing, near = segment_grabcut(odds, rgb, hand | far), dilate(hand, model.ring_px)
    found = [part for part in components(thing, model.least_px, HALO_PX) if (part & near).any()]
    return [Segment(part) for part in found if not _leaves_picture(part) or p[part].mean() > 0.5]


def _leaves_picture(part: np.ndarray) -> bool:
    """Test whether a segment touches the border of the picture. A moving one usually is the sleeve of the hand."""
    return bool(part[0].any() or part[-1].any() or part[:, 0].any() or part[:, -1].any())


def contacts(objects: Sequence[Track], hands: HandMasks, count: int, ring_px: int, least: int) -> dict[Hand, np.ndarray]:
    """Find the contact of each side: index of the touched object in each sampled frame, NOTHING without contact or hand.

    A contact of fewer than `least` sampled frames in a row is dropped, unless the hand itself is visible for no longer.
    """
    touched = {side: [_touched_object(objects, hands[side].get(k), k, ring_px) for k in range(count)] for side in SIDES}
    return {side: _drop_short_contacts(touched[side], hands[side], least) for side in SIDES}


def _touched_object(objects: Sequence[Track], hand: np.ndarray | None, k: int, ring_px: int) -> int:
    if hand is None:
        return NOTHING
    ring = dilate(hand, ring_px)
    overlap = [int((ring & one.segments[k].mask).sum()) if k in one.segments else 0 for one in objects]
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
