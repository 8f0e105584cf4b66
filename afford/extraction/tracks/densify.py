"""Densify sparse masks into tracks: link annotations to entities, propagate labels run by run, record the source of each mask.

The two backends that estimate no motion, `nearest` and `dense`, are at the end.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from afford.extraction.tracks import BACKGROUND, UNKNOWN, Propagated, Tracking
from afford.extraction.tracks.contact import contact_at_keys, spread_contact
from afford.extraction.tracks.key_frames import (
    Bracket,
    EntityLinks,
    Key,
    PropagateMasks,
    bracket,
    link_entities,
    nearest_source,
    read_keys,
    runs,
    track_flags,
)
from schemas.masks import Tracks
from schemas.video import Clip, Frames

Propagator = Callable[[np.ndarray, np.ndarray, np.ndarray, int], Propagated]
"""a backend with its parameters bound, see `Propagate`: frames, positions of key frames, their labels, number of entities"""


def densify(clip: Clip, frames: Frames, propagate: Propagator, params: Tracking, dense: bool = False) -> Tracks:
    """Compute masks of every hand and every touched object on every frame; `dense`: from the dense annotations of the source."""
    keys = read_keys(clip, frames, dense)
    parts = runs(frames.frame, params.max_step_frames)
    links = link_entities(keys, _mask_propagator(frames, parts, propagate), params.link_min_iou)
    propagated = _propagate_runs(frames, parts, keys, links, propagate)
    around = bracket(frames.frame, parts, np.array([key.at for key in keys]))
    return _tracks(clip, frames, keys, links, propagated, around, params)


def _tracks(
    clip: Clip, frames: Frames, keys: list[Key], links: EntityLinks, propagated: Propagated, around: Bracket, params: Tracking
) -> Tracks:
    annotated = contact_at_keys(keys, links, params.contact_reach_px)
    kept = _kept(links, annotated, params.keep_untouched)
    present = _present(keys, links)[kept]
    masks = propagated.labels[None] == (np.array(kept, np.int16) + 1)[:, None, None, None]
    source, distance = nearest_source(frames.frame, around, present)
    masks &= ((source >= 0) & ((distance <= params.radius) | (params.radius == 0)))[:, :, None, None]
    visible = masks.any(axis=(2, 3))
    renamed = np.array([kept.index(int(i)) if i >= 0 else i for i in annotated.ravel()], np.int16).reshape(annotated.shape)
    entities = tuple(links.entities[i] for i in kept)
    contact, contact_distance = spread_contact(renamed, around, frames.frame, entities, masks, params.contact_reach_px)
    return Tracks(
        clip_id=clip.clip_id,
        entities=entities,
        frame=frames.frame,
        masks=masks,
        confidence=np.where(visible, propagated.confidence[kept], 0).astype(np.float32),
        flags=track_flags(visible, around, present),
        source_frame=np.where(visible, source, -1),
        distance=np.where(visible, distance, -1).astype(np.int32),
        contact=contact,
        contact_distance=contact_distance,
    )


def _kept(links: EntityLinks, contact: np.ndarray, keep_untouched: bool) -> list[int]:
    """Select the indices of the hands, and of the objects that a hand touches in some key frame."""
    touched = set(contact.ravel().tolist())
    return [i for i, e in enumerate(links.entities) if e.role == "hand" or i in touched or keep_untouched]


def _present(keys: list[Key], links: EntityLinks) -> np.ndarray:
    """Table (n, k) bool: entity i is annotated in key frame k."""
    return np.array([[i in row for row in links.of] for i in range(len(links.entities))], bool).reshape(-1, len(keys))


def _propagate_runs(frames: Frames, parts: list[slice], keys: list[Key], links: EntityLinks, propagate: Propagator) -> Propagated:
    """Propagate labels within each run; a run without a key frame stays empty."""
    labels = np.zeros(frames.rgb.shape[:3], np.int16)
    confidence = np.zeros((len(links.entities), len(frames.frame)), np.float32)
    painted = [_paint(key, of) for key, of in zip(keys, links.of, strict=True)]
    for part in parts:
        mine = [k for k, key in enumerate(keys) if part.start <= key.at < part.stop]
        if mine:
            at = np.array([keys[k].at for k in mine]) - part.start
            found = propagate(frames.rgb[part], at, np.stack([painted[k] for k in mine]), len(links.entities))
            labels[part], confidence[:, part] = found.labels, found.confidence
    return Propagated(labels, confidence)


def _paint(key: Key, entity: list[int]) -> np.ndarray:
    """Paint the label image (h, w) int16 of one key frame: objects first, then hands, each from large to small."""
    labels = np.zeros(key.masks.shape[1:], np.int16)
    is_hand = [annotation.side != "" for annotation in key.annotations]
    for i in sorted(range(len(entity)), key=lambda i: (is_hand[i], -np.count_nonzero(key.masks[i]))):
        labels[key.masks[i]] = entity[i] + 1 if entity[i] >= 0 else UNKNOWN
    return labels


def _mask_propagator(frames: Frames, parts: list[slice], propagate: Propagator) -> PropagateMasks:
    """Return a function that propagates masks from one key frame to another, or keeps them in place across a gap of the video."""

    def propagate_masks(last: Key, key: Key, masks: np.ndarray) -> np.ndarray:
        if not any(part.start <= last.at and key.at < part.stop for part in parts):
            return masks
        labels = np.zeros((1, *masks.shape[1:]), np.int16)
        for i, mask in enumerate(masks):
            labels[0, mask] = i + 1
        found = propagate(frames.rgb[last.at : key.at + 1], np.zeros(1, np.int64), labels, len(masks))
        return found.labels[-1][None] == np.arange(1, len(masks) + 1)[:, None, None]

    return propagate_masks


def nearest(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: None) -> Propagated:
    """Copy the labels of the nearest key frame: the baseline.

    The earlier key frame wins a tie. Confidence halves with every second of a 30 fps video.
    """
    distance = np.abs(np.arange(len(rgb))[:, None] - key_index[None])
    source = distance.argmin(axis=1)
    labels = np.where(key_labels == UNKNOWN, BACKGROUND, key_labels).astype(np.int16)[source]
    trust = (0.5 ** (distance.min(axis=1) / 30)).astype(np.float32)
    seen = np.stack([(labels == i + 1).any(axis=(1, 2)) for i in range(count)]) if count else np.zeros((0, len(rgb)), bool)
    return Propagated(labels, seen * trust)


def dense(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: None) -> Propagated:
    """Copy the dense labels of the source (VISOR's interpolations); other frames stay empty. Confidence is 1 on labels."""
    labels = np.zeros(rgb.shape[:3], np.int16)
    labels[key_index] = np.where(key_labels == UNKNOWN, BACKGROUND, key_labels)
    confidence = np.zeros((count, len(rgb)), np.float32)
    for i in range(count):
        confidence[i] = (labels == i + 1).any(axis=(1, 2))
    return Propagated(labels, confidence)
