"""Cutting of a video into clips: at gaps between key frames that are too long for tracking, and at a maximum length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from afford.extraction.sources.media import Media


@dataclass(frozen=True)
class Cutting:
    """Limits of gaps and clips."""

    max_gap_s: float
    """longest gap between key frames with frames in between"""
    max_still_gap_s: float
    """longest gap between key frames without frames in between"""
    max_frames: int
    """longest clip, without its margins"""
    margin_frames: int
    """frames kept before the first and after the last key frame"""


@dataclass(frozen=True)
class ClipRange:
    """Range of frame numbers of a clip, inclusive."""

    first: int
    last: int


def cut_video(keys: Sequence[int], media: Media, cutting: Cutting) -> list[ClipRange]:
    """Cut a video with key frames at `keys` (ascending, all among `media.numbers`) into clips.

    A long clip is cut at a key frame that both sides keep, so that every frame has a key frame before and after it. Margins stop
    halfway to the next key frame and never cross a cut.
    """
    parts: list[ClipRange] = []
    groups = _groups(keys, media, cutting)
    for i, group in enumerate(groups):
        pieces = _split_long(group, media, cutting.max_frames)
        before = groups[i - 1][-1] if i else None
        after = groups[i + 1][0] if i + 1 < len(groups) else None
        low = group[0] - _margin(group[0], before, cutting)
        high = group[-1] + _margin(group[-1], after, cutting)
        first, behind = np.searchsorted(media.numbers, low), np.searchsorted(media.numbers, high, "right")
        starts = [int(media.numbers[first]), *(a for a, _ in pieces[1:])]
        stops = [*(b for _, b in pieces[:-1]), int(media.numbers[behind - 1])]
        parts.extend(ClipRange(a, b) for a, b in zip(starts, stops, strict=True))
    return parts


def _margin(key: int, other: int | None, cutting: Cutting) -> int:
    return cutting.margin_frames if other is None else min(cutting.margin_frames, (abs(other - key) - 1) // 2)


def _groups(keys: Sequence[int], media: Media, cutting: Cutting) -> list[list[int]]:
    """Group key frames without long gaps."""
    at = np.searchsorted(media.numbers, keys)
    groups = [[keys[0]]]
    for i in range(1, len(keys)):
        limit_s = cutting.max_gap_s if at[i] - at[i - 1] > 1 else cutting.max_still_gap_s
        if media.times_s[at[i]] - media.times_s[at[i - 1]] > limit_s:
            groups.append([])
        groups[-1].append(keys[i])
    return groups


def _split_long(group: Sequence[int], media: Media, max_frames: int) -> list[tuple[int, int]]:
    """Split a group into (first, last) key frames of at most `max_frames` frames; a single long gap may exceed it."""
    at = np.searchsorted(media.numbers, group)
    cuts = [0]
    for i in range(1, len(group)):
        if at[i] - at[cuts[-1]] >= max_frames and i - 1 > cuts[-1]:
            cuts.append(i - 1)
    return [(group[a], group[b]) for a, b in zip(cuts, [*cuts[1:], len(group) - 1], strict=True)]
