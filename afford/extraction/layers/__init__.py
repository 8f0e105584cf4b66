"""Layers of a clip: camera motion, background, moving shapes; what is behind the hands."""

from __future__ import annotations

import numpy as np

from schemas.masks import Tracks


def hands(tracks: Tracks) -> np.ndarray:
    """(t, h, w) bool: pixels of any hand."""
    return _union(tracks, [i for i, entity in enumerate(tracks.entities) if entity.role == "hand"])


def objects(tracks: Tracks) -> np.ndarray:
    """(t, h, w) bool: visible pixels of any object."""
    return _union(tracks, object_indices(tracks))


def others(tracks: Tracks, index: int) -> np.ndarray:
    """(t, h, w) bool: visible pixels of every entity but one: what may hide it."""
    return _union(tracks, [i for i in range(len(tracks.entities)) if i != index])


def told(tracks: Tracks) -> np.ndarray:
    """(t,) bool: frames that some key frame speaks for; in others the hands are there but have no mask."""
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
