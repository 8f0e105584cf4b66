"""A video is cut into clips where its key frames are too far apart to follow anything between them, and where it gets long."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from afford.extraction.sources.media import Media


@dataclass(frozen=True)
class Cutting:
    """Where to cut."""

    max_gap_s: float
    """longest gap between key frames with frames in between"""
    max_still_gap_s: float
    """longest gap between key frames with nothing in between"""
    max_frames: int
    """longest clip, margins apart"""
    margin_frames: int
    """frames kept before the first and after the last key frame"""


@dataclass(frozen=True)
class Part:
    """One clip to be: `first` and `last` frame number, inclusive."""

    first: int
    last: int


def cut(keys: Sequence[int], media: Media, cutting: Cutting) -> list[Part]:
    """Parts of a video with key frames at `keys` (ascending, all among `media.numbers`).

    A long stretch is cut at a key frame, which both sides keep, so that every frame has a key frame before and after it.
    Margins stop halfway to the next key frame and never cross a cut.
    """
    parts: list[Part] = []
    groups = _groups(keys, media, cutting)
    for i, group in enumerate(groups):
        pieces = _pieces(group, media, cutting.max_frames)
        before = groups[i - 1][-1] if i else None
        after = groups[i + 1][0] if i + 1 < len(groups) else None
        low = group[0] - _margin(group[0], before, cutting)
        high = group[-1] + _margin(group[-1], after, cutting)
        first, behind = np.searchsorted(media.numbers, low), np.searchsorted(media.numbers, high, "right")
        starts = [int(media.numbers[first]), *(a for a, _ in pieces[1:])]
        stops = [*(b for _, b in pieces[:-1]), int(media.numbers[behind - 1])]
        parts.extend(Part(a, b) for a, b in zip(starts, stops, strict=True))
    return parts


def _margin(key: int, other: int | None, cutting: Cutting) -> int:
    return cutting.margin_frames if other is None else min(cutting.margin_frames, (abs(other - key) - 1) // 2)


def _groups(keys: Sequence[int], media: Media, cutting: Cutting) -> list[list[int]]:
    """Key frames without a gap that is too wide."""
    at = np.searchsorted(media.numbers, keys)
    groups = [[keys[0]]]
    for i in range(1, len(keys)):
        limit_s = cutting.max_gap_s if at[i] - at[i - 1] > 1 else cutting.max_still_gap_s
        if media.times_s[at[i]] - media.times_s[at[i - 1]] > limit_s:
            groups.append([])
        groups[-1].append(keys[i])
    return groups


def _pieces(group: Sequence[int], media: Media, max_frames: int) -> list[tuple[int, int]]:
    """(first, last) key frames of pieces of at most `max_frames` frames; a single wide gap may exceed it."""
    at = np.searchsorted(media.numbers, group)
    cuts = [0]
    for i in range(1, len(group)):
        if at[i] - at[cuts[-1]] >= max_frames and i - 1 > cuts[-1]:
            cuts.append(i - 1)
    return [(group[a], group[b]) for a, b in zip(cuts, [*cuts[1:], len(group) - 1], strict=True)]
