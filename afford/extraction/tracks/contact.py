"""Contact of each hand, frame by frame: annotated in key frames, propagated between them."""

from __future__ import annotations

import numpy as np

from afford.common.masks import dilate
from afford.extraction.tracks.key_frames import Bracket, EntityLinks, Key
from schemas.masks import Entity
from schemas.video import NOT_IN_CONTACT, SIDES, Annotation

NOTHING = -1
UNKNOWN = -2


def contact_at_keys(keys: list[Key], links: EntityLinks, reach_px: int) -> np.ndarray:
    """Entity that the (left, right) hand touches in each key frame, NOTHING or UNKNOWN: (2, k) int16.

    A hand that is not annotated touches nothing. Where the source does not annotate contact, a hand touches the object that
    its mask, dilated by `reach_px`, overlaps most.
    """
    out = np.full((2, len(keys)), NOTHING, np.int16)
    for k, key in enumerate(keys):
        for i, annotation in enumerate(key.annotations):
            if annotation.side in SIDES:
                out[SIDES.index(annotation.side), k] = _annotated_contact(key, links.of[k], i, annotation, reach_px)
    return out


def _annotated_contact(key: Key, entity: list[int], hand: int, annotation: Annotation, reach_px: int) -> int:
    if annotation.contact in NOT_IN_CONTACT:
        return NOTHING
    if annotation.contact == "":
        return _nearest_object(key, entity, hand, reach_px)
    for i, other in enumerate(key.annotations):
        if other.annotation_id == annotation.contact:
            return entity[i] if other.side == "" else NOTHING
    return UNKNOWN


def _nearest_object(key: Key, entity: list[int], hand: int, reach_px: int) -> int:
    overlap = [int(np.count_nonzero(dilate(key.masks[hand], reach_px) & mask)) if a.side == "" else 0
               for mask, a in zip(key.masks, key.annotations, strict=True)]
    best = int(np.argmax(overlap))
    return entity[best] if overlap[best] else NOTHING


def spread_contact(
    at_keys: np.ndarray, around: Bracket, frame: np.ndarray, entities: tuple[Entity, ...], masks: np.ndarray, reach_px: int
) -> tuple[np.ndarray, np.ndarray]:
    """Propagate contact to all frames: (2, t) int16, and the distance (2, t) int32 in frames to its key frame.

    at_keys: (2, k) contact in the key frames. masks: (n, t, h, w) bool. Between two key frames the contact switches at most
    once; before the first and after the last it is that of the nearest. A run without a key frame gets UNKNOWN and -1.
    """
    source = np.where(around.before >= 0, around.before, around.after)[None].repeat(2, axis=0)
    for k in range(len(around.at) - 1):
        between = np.flatnonzero((around.before == k) & (around.after == k + 1))
        for side in range(2 if len(between) else 0):
            before, after = int(at_keys[side, k]), int(at_keys[side, k + 1])
            hand = next((i for i, e in enumerate(entities) if e.side == SIDES[side]), NOTHING)
            close = np.stack([_overlaps(masks[:, between], hand, entity, reach_px) for entity in (before, after)])
            source[side, between] = k + (np.arange(len(between)) >= _switch_frame(before, after, close))
    contact = np.where(source >= 0, np.take_along_axis(at_keys, source, axis=1), UNKNOWN)
    distance = np.where(source >= 0, np.abs(frame - frame[around.at][source]), -1)
    return contact.astype(np.int16), distance.astype(np.int32)


def _overlaps(masks: np.ndarray, hand: int, entity: int, reach_px: int) -> np.ndarray:
    """Frames (m,) bool in which the dilated hand overlaps the entity; all False when either index is negative."""
    if entity < 0 or hand < 0:
        return np.zeros(masks.shape[1], bool)
    return np.array([(dilate(a, reach_px) & b).any() for a, b in zip(masks[hand], masks[entity], strict=True)], bool)


def _switch_frame(before: int, after: int, close: np.ndarray) -> int:
    """Find the first of m frames between two key frames with contact `after` instead of `before`; m when there is no switch.

    The switch minimises the number of contradicting frames; ties go to the middle. A frame contradicts an object that the hand
    does not reach. It contradicts NOTHING when the hand reaches the other object. UNKNOWN is never contradicted.
    """
    m = close.shape[1]
    early, late = _contradictions(before, close[0], close[1]), _contradictions(after, close[1], close[0])
    if UNKNOWN in (before, after):
        early, late = np.zeros(m), np.zeros(m)
    cost = np.concatenate([[0], np.cumsum(early)]) + np.concatenate([np.cumsum(late[::-1])[::-1], [0]])
    off_middle = np.abs(np.arange(m + 1) - m / 2) / (m + 1)
    return int((cost + 0.5 * off_middle).argmin())


def _contradictions(label: int, reaches: np.ndarray, reaches_other: np.ndarray) -> np.ndarray:
    return reaches_other if label == NOTHING else ~reaches
