"""Layers of a clip: background by camera motion, objects by their own motion; masks of hands, objects and occluders."""

from __future__ import annotations

import numpy as np

from schemas.masks import Tracks


def hands(tracks: Tracks) -> np.ndarray:
    """Union of the masks of all hands, (t, h, w) bool."""
    return _union(tracks, [i for i, entity in enumerate(tracks.entities) if entity.role == "hand"])


def objects(tracks: Tracks) -> np.ndarray:
    """Union of the visible masks of all objects, (t, h, w) bool."""
    return _union(tracks, object_indices(tracks))


def others(tracks: Tracks, index: int) -> np.ndarray:
    """Union of the visible masks of all entities except one, its possible occluders, (t, h, w) bool."""
    return _union(tracks, [i for i in range(len(tracks.entities)) if i != index])


def annotated_frames(tracks: Tracks) -> np.ndarray:
    """Frames (t,) bool with masks from a key frame; in other frames hands may be visible without a mask."""
    return np.asarray((tracks.source_frame >= 0).any(axis=0))


def object_indices(tracks: Tracks) -> list[int]:
    """Indices of the objects in `tracks.entities`."""
    return [i for i, entity in enumerate(tracks.entities) if entity.role == "object"]


def touched_indices(tracks: Tracks) -> list[int]:
    """Indices of the objects that a hand ever touches, in the order of `tracks.entities`."""
    return sorted({int(i) for i in np.unique(tracks.contact) if i >= 0} & set(object_indices(tracks)))


def _union(tracks: Tracks, indices: list[int]) -> np.ndarray:
    total = np.zeros(tracks.masks.shape[1:], bool)
    for i in indices:
        total |= tracks.masks[i]
    return total
