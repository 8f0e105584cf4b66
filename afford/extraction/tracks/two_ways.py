"""Propagate key-frame masks with a video model in both directions, weighted by nearness to the key frames.

Between two key frames one pass starts at the earlier key frame, one at the later, and their logits are blended. `memory_keys` key
frames on each side of the gap prompt the model.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise

import numpy as np
import torch

from afford.extraction.tracks import BACKGROUND, UNKNOWN, Propagated
from afford.models.frame_masks import FrameMasks, full_size

Pass = Callable[[list[int]], Iterable[FrameMasks]]
"""propagation through frames in ascending or descending order, the first of which is a key frame"""
Start = Callable[[dict[int, np.ndarray]], Pass]
"""start of the passes of a gap, from frame position -> (n, h, w) bool masks of the key frames in memory"""


def propagate_two_ways(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, memory_keys: int,
                       start: Start) -> Propagated:  # fmt: skip
    """Propagate with a video model, see `Propagate`.

    The entity with the largest logit gets a pixel; confidence is the mean probability.
    """
    labels = np.zeros(rgb.shape[:3], np.int16)
    confidence = np.zeros((count, len(rgb)), np.float32)
    labels[key_index] = np.where(key_labels == UNKNOWN, BACKGROUND, key_labels)
    for i in range(count):
        confidence[i, key_index] = (key_labels == i + 1).any(axis=(1, 2))
    for before, after in pairwise([None, *range(len(key_index)), None]):
        near = _memory_keys(before, after, len(key_index), memory_keys)
        local = np.setdiff1d(np.unique(key_labels[near]), (BACKGROUND, UNKNOWN))
        first, last = (None if k is None else int(key_index[k]) for k in (before, after))
        between = range(0 if first is None else first + 1, len(rgb) if last is None else last)
        if not len(local) or not between:
            continue
        one_way = start({int(key_index[k]): key_labels[k][None] == local[:, None, None] for k in near})
        for at, logits in _blend_directions(one_way, between, first, last):
            found = full_size(logits, rgb.shape[1:3])
            inside = found.max(axis=0) > 0
            labels[at] = np.where(inside, local[found.argmax(axis=0)], BACKGROUND)
            confidence[local - 1, at] = _confidence(found, labels[at], local)
    return Propagated(labels, confidence)


def _memory_keys(before: int | None, after: int | None, count: int, keys: int) -> list[int]:
    """Key frames that prompt the model between two neighbouring ones: `keys` on each side, at least one."""
    early = range(max(before - max(keys, 1) + 1, 0), before + 1) if before is not None else range(0)
    late = range(after, min(after + max(keys, 1), count)) if after is not None else range(0)
    return [*early, *late]


def _blend_directions(one_way: Pass, between: range, first: int | None, last: int | None) -> Iterator[tuple[int, torch.Tensor]]:
    """Yield logits (n, h', w') of the frames between two key frames, or beyond the only one."""
    forwards = (seen for seen in one_way([first, *between]) if seen.at in between) if first is not None else iter(())
    backwards = (seen for seen in one_way([last, *between[::-1]]) if seen.at in between) if last is not None else iter(())
    if first is None or last is None:
        yield from ((seen.at, seen.logits) for way in (forwards, backwards) for seen in way)
        return
    there = {seen.at: seen.logits.half() for seen in forwards}
    for seen in backwards:
        nearness = (last - seen.at) / (last - first)
        yield seen.at, nearness * there.pop(seen.at).float() + (1 - nearness) * seen.logits


def _confidence(logits: np.ndarray, labels: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Mean probability (n,) float32 of the pixels of each entity, 0 for an entity without pixels."""
    out = np.zeros(len(local), np.float32)
    for i, label in enumerate(local):
        inside = logits[i][labels == label]
        out[i] = (1 / (1 + np.exp(-inside))).mean() if inside.size else 0.0
    return out
