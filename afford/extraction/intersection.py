"""Affordance by intersection: the part of a complete object that a hand covers, its taxonomy, quality and reasons for rejection.

Row 0 is the left hand, row 1 the right. An object is an index into `CompleteObjects.entities`, -1 without an object.
"""

from __future__ import annotations

import cv2
import numpy as np

from schemas.affordance import Rejection, Taxonomy
from schemas.masks import CompleteObjects, Tracks
from schemas.video import SIDES

PAPER_SIDE_PX = 855
UNKNOWN_CONTACT = -2
NO_OBJECT = -1
OTHER_HAND_UNKNOWN = np.float32(0.5)
"""factor of the quality of a frame in which the contact of the other hand is unknown"""


def scale(masks: np.ndarray) -> float:
    """Working pixels per pixel of the paper's 855 x 855 square, to which the paper pads masks (..., h, w)."""
    return max(masks.shape[-2:]) / PAPER_SIDE_PX


def touched_objects(tracks: Tracks, complete: CompleteObjects) -> np.ndarray:
    """Object that each hand touches, (2, t) int16; -1 without contact and for unknown contact."""
    place = {entity.entity_id: i for i, entity in enumerate(complete.entities)}
    lookup = np.array([place.get(entity.entity_id, NO_OBJECT) for entity in tracks.entities] or [NO_OBJECT], np.int16)
    return np.where(tracks.contact >= 0, lookup[np.maximum(tracks.contact, 0)], np.int16(NO_OBJECT))


def hand_masks(tracks: Tracks) -> np.ndarray:
    """Visible masks (2, t, h, w) bool of the left and the right hand."""
    masks = np.zeros((2, *tracks.masks.shape[1:]), bool)
    for entity, mask in zip(tracks.entities, tracks.masks, strict=True):
        if entity.role == "hand":
            masks[SIDES.index(entity.side)] |= mask
    return masks


def intersect(tracks: Tracks, complete: CompleteObjects, objects: np.ndarray) -> np.ndarray:
    """Intersect each hand with the complete object that it touches, (2, t, h, w) bool; empty without contact."""
    masks = hand_masks(tracks)
    for side, row in enumerate(objects):
        for t, index in enumerate(row):
            masks[side, t] &= complete.masks[index, t] if index >= 0 else False
    return masks


def dilate_square(masks: np.ndarray, side_px: int) -> np.ndarray:
    """Dilate masks (2, t, h, w) bool by a square of `side_px`, as the paper's code does; 0 or 1 changes nothing."""
    if side_px <= 1:
        return masks
    square = np.ones((side_px, side_px), np.uint8)
    return np.stack([[cv2.dilate(mask.view(np.uint8), square) > 0 for mask in row] for row in masks])


def taxonomy(objects: np.ndarray) -> np.ndarray:
    """Classify (2, t) objects into the four-way Taxonomy, (t,) int8."""
    left, right = objects >= 0
    both = np.where(objects[0] == objects[1], Taxonomy.BOTH_SAME, Taxonomy.BOTH_DIFFERENT)
    one = np.where(left, Taxonomy.LEFT, np.where(right, Taxonomy.RIGHT, Taxonomy.NONE))
    return np.where(left & right, both, one).astype(np.int8)


def taxonomy3(objects: np.ndarray) -> np.ndarray:
    """Classify (2, t) objects as in the paper's first version, (t,) int8.

    0: one hand; 1: both on the same object; 2: both on different objects; -1: no contact.
    """
    return np.array([0, 0, 1, 2, -1], np.int8)[taxonomy(objects)]


def quality(
    tracks: Tracks, complete: CompleteObjects, objects: np.ndarray, masks: np.ndarray, fade_frames: float
) -> np.ndarray:
    """Quality score (t,) float32 in 0..1 of each frame: that of the less certain hand.

    The score of a hand is the confidence of its masks, times a decay with the distance to the key frame that annotates the contact.
    """
    total = np.ones(len(tracks.frame), np.float32)
    for side, row in enumerate(objects):
        active = row >= 0
        if active.any():
            total[active] = np.minimum(total, _hand_confidence(tracks, complete, side, row, masks[side], fade_frames))[active]
        total[tracks.contact[side] == UNKNOWN_CONTACT] *= OTHER_HAND_UNKNOWN
    return np.where((objects >= 0).any(axis=0), total, np.float32(0)).astype(np.float32)


def _hand_confidence(
    tracks: Tracks, complete: CompleteObjects, side: int, row: np.ndarray, affordance: np.ndarray, fade_frames: float
) -> np.ndarray:
    at = np.arange(len(row))
    hands = [i for i, entity in enumerate(tracks.entities) if entity.side == SIDES[side]]
    hand = tracks.confidence[hands].max(axis=0) if hands else np.zeros(len(row), np.float32)
    thing = tracks.confidence[np.maximum(tracks.contact[side], 0), at]
    whole = complete.confidence[np.maximum(row, 0), at] if len(complete.entities) else np.zeros(len(row), np.float32)
    recent = 0.5 ** (np.maximum(tracks.contact_distance[side], 0) / fade_frames)
    return np.sqrt(np.minimum(hand, thing) * whole) * recent * (affordance.any(axis=(1, 2)))


def rejection(
    tracks: Tracks, complete: CompleteObjects, objects: np.ndarray, masks: np.ndarray, quality: np.ndarray,
    limits: tuple[float, ...], min_quality: float,
) -> np.ndarray:  # fmt: skip
    """Reason for Rejection of each frame, (t,) uint8: the first that applies, in the order of the enum.

    Every touching hand must pass.

    masks: (2, t, h, w) bool. limits: smallest and largest area in working pixels.
    """
    active = objects >= 0
    area = np.count_nonzero(masks, axis=(2, 3))
    absent = active & (_areas(complete, objects) == 0) | (tracks.contact >= 0) & ~active
    touching = (tracks.contact >= 0).any(axis=0)
    unknown = (tracks.contact == UNKNOWN_CONTACT).any(axis=0)
    reasons = [
        (Rejection.NO_CONTACT, ~touching & ~unknown),
        (Rejection.CONTACT_UNKNOWN, ~touching & unknown),
        (Rejection.OBJECT_MISSING, absent.any(axis=0)),
        (Rejection.EMPTY_INTERSECTION, (active & (area == 0)).any(axis=0)),
        (Rejection.TOO_SMALL, (active & (area < limits[0])).any(axis=0)),
        (Rejection.TOO_LARGE, (active & (area >= limits[1])).any(axis=0)),
        (Rejection.LOW_QUALITY, quality < min_quality),
    ]
    return np.select([where for _, where in reasons], [reason for reason, _ in reasons], Rejection.ACCEPTED).astype(np.uint8)


def _areas(complete: CompleteObjects, objects: np.ndarray) -> np.ndarray:
    """Area (2, t) in pixels of the complete object of each hand, 0 without an object."""
    if not complete.entities:
        return np.zeros(objects.shape, int)
    areas = np.count_nonzero(complete.masks, axis=(2, 3))
    return np.where(objects >= 0, areas[np.maximum(objects, 0), np.arange(objects.shape[1])], 0)
