"""Where a hand lies on the complete object it touches, what kind of task that is, and how far the answer can be trusted.

Everywhere: row 0 is the left hand, row 1 the right; an object is an index into `CompleteObjects.entities`, -1 for none.
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
"""quality of a frame in which it is not known whether the other hand takes part"""


def scale(masks: np.ndarray) -> float:
    """Working pixels per pixel of the paper's 855 x 855 square, for masks (..., h, w) that are padded to a square there."""
    return max(masks.shape[-2:]) / PAPER_SIDE_PX


def touched_objects(tracks: Tracks, complete: CompleteObjects) -> np.ndarray:
    """(2, t) int16: the object of each hand, -1 for none or unknown contact."""
    place = {entity.entity_id: i for i, entity in enumerate(complete.entities)}
    lookup = np.array([place.get(entity.entity_id, NO_OBJECT) for entity in tracks.entities] or [NO_OBJECT], np.int16)
    return np.where(tracks.contact >= 0, lookup[np.maximum(tracks.contact, 0)], np.int16(NO_OBJECT))


def hand_masks(tracks: Tracks) -> np.ndarray:
    """(2, t, h, w) bool: visible left and right hand."""
    masks = np.zeros((2, *tracks.masks.shape[1:]), bool)
    for entity, mask in zip(tracks.entities, tracks.masks, strict=True):
        if entity.role == "hand":
            masks[SIDES.index(entity.side)] |= mask
    return masks


def intersect(tracks: Tracks, complete: CompleteObjects, objects: np.ndarray) -> np.ndarray:
    """(2, t, h, w) bool: hand AND complete object of that hand; empty without contact."""
    masks = hand_masks(tracks)
    for side, row in enumerate(objects):
        for t, index in enumerate(row):
            masks[side, t] &= complete.masks[index, t] if index >= 0 else False
    return masks


def dilate_square(masks: np.ndarray, side_px: int) -> np.ndarray:
    """(2, t, h, w) bool, grown by a square of this side as the paper's code does; a side of 0 or 1 changes nothing."""
    if side_px <= 1:
        return masks
    square = np.ones((side_px, side_px), np.uint8)
    return np.stack([[cv2.dilate(mask.view(np.uint8), square) > 0 for mask in row] for row in masks])


def taxonomy(objects: np.ndarray) -> np.ndarray:
    """(t,) int8 Taxonomy of (2, t) objects."""
    left, right = objects >= 0
    both = np.where(objects[0] == objects[1], Taxonomy.BOTH_SAME, Taxonomy.BOTH_DIFFERENT)
    one = np.where(left, Taxonomy.LEFT, np.where(right, Taxonomy.RIGHT, Taxonomy.NONE))
    return np.where(left & right, both, one).astype(np.int8)


def taxonomy3(objects: np.ndarray) -> np.ndarray:
    """(t,) int8: 0 one hand, 1 both on one object, 2 both on different ones, -1 none (the paper's first version)."""
    return np.array([0, 0, 1, 2, -1], np.int8)[taxonomy(objects)]


def quality(
    tracks: Tracks, complete: CompleteObjects, objects: np.ndarray, masks: np.ndarray, fade_frames: float
) -> np.ndarray:
    """(t,) float32 in 0..1: the worse hand's trust in its masks, times how recently an annotator confirmed the contact."""
    total = np.ones(len(tracks.frame), np.float32)
    for side, row in enumerate(objects):
        active = row >= 0
        if active.any():
            total[active] = np.minimum(total, _trust(tracks, complete, side, row, masks[side], fade_frames))[active]
        total[tracks.contact[side] == UNKNOWN_CONTACT] *= OTHER_HAND_UNKNOWN
    return np.where((objects >= 0).any(axis=0), total, np.float32(0)).astype(np.float32)


def _trust(
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
    """(t,) uint8 Rejection: the first reason that applies, in the order of the enum; every touching hand must pass.

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
    """(2, t): pixels of each hand's complete object, 0 without one."""
    if not complete.entities:
        return np.zeros(objects.shape, int)
    areas = np.count_nonzero(complete.masks, axis=(2, 3))
    return np.where(objects >= 0, areas[np.maximum(objects, 0), np.arange(objects.shape[1])], 0)
