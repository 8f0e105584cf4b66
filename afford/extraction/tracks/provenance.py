"""Which key frames a mask leans on: the last one before and the first one after each frame, in the same run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from schemas.masks import TrackFlag


@dataclass(frozen=True)
class Bracket:
    """Key frames around each frame, as indices into the k key frames, -1 for none. A key frame is on both sides of itself."""

    at: np.ndarray
    """(k,) positions of the key frames"""
    before: np.ndarray
    """(t,) int64"""
    after: np.ndarray
    """(t,) int64"""


def bracket(frame: np.ndarray, parts: list[slice], at: np.ndarray) -> Bracket:
    """Key frames `at` (k,) around each of `frame` (t,); `parts` are the runs that no propagation crosses."""
    before, after = np.full(len(frame), -1), np.full(len(frame), -1)
    for part in parts:
        position = np.arange(part.start, part.stop)
        left, right = np.searchsorted(at, position, "right") - 1, np.searchsorted(at, position, "left")
        before[part] = np.where((left >= 0) & (at[left] >= part.start), left, -1)
        inside = right < len(at)
        after[part] = np.where(inside & (at[np.minimum(right, len(at) - 1)] < part.stop), right, -1)
    return Bracket(at, before, after)


def source_of(frame: np.ndarray, around: Bracket, present: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frame number of the nearest bracketing key frame that shows the entity, earlier on a tie, and the distance to it.

    present: (n, k) bool. Returns two (n, t) int64 arrays, -1 where neither key frame shows it.
    """
    key_frame = frame[around.at]
    gaps = []
    for key in (around.before, around.after):
        shown = present[:, key] & (key >= 0)
        gaps.append(np.where(shown, np.abs(frame - key_frame[key]), np.iinfo(np.int64).max))
    nearer_before = gaps[0] <= gaps[1]
    distance = np.minimum(*gaps)
    source = np.where(nearer_before, key_frame[around.before], key_frame[around.after])
    none = distance == np.iinfo(np.int64).max
    return np.where(none, -1, source), np.where(none, -1, distance)


def flags_of(visible: np.ndarray, around: Bracket, present: np.ndarray) -> np.ndarray:
    """TrackFlag bits (n, t) uint8. ENTERING and LEAVING mark every frame between the two key frames, in sight or not."""
    shown_before, shown_after = (present[:, key] & (key >= 0) for key in (around.before, around.after))
    both = (around.before >= 0) & (around.after >= 0)
    is_key = both & (around.before == around.after)
    bits = np.where(visible, TrackFlag.VISIBLE, 0)
    bits |= np.where(is_key & shown_before, TrackFlag.KEY, 0)
    bits |= np.where(both & ~shown_before & shown_after, TrackFlag.ENTERING, 0)
    bits |= np.where(both & shown_before & ~shown_after, TrackFlag.LEAVING, 0)
    return bits.astype(np.uint8)
