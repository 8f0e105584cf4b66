"""Propagate key-frame masks with SAM 2 video segmentation, forwards and backwards, weighted by nearness to the key frames.

Between two key frames `params.memory_keys` key frames on each side are prompts. One pass starts at the earlier key frame, one
at the later, and their logits are blended by nearness.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import torch

from afford.extraction.tracks import BACKGROUND, UNKNOWN, Propagated, Sam2
from afford.models.sam2 import FrameMasks, full_size, load_model, session, track_frames

WEIGHTS = "a Sam2VideoModel: folder of save_pretrained, sam2*_hiera_*.pt, or hub id as facebook/sam2.1-hiera-tiny"
MET = ("published size, random weights, 2026-11: SAM 2.1 large, 8.7 frames/s of two objects on an H200; names and counts of "
       "all four sizes")


def propagate(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: Sam2) -> Propagated:
    """Propagate with SAM 2, see `Propagate`. The entity with the largest logit gets a pixel; confidence is the mean probability."""
    model = load_model(params.model, params.device, params.dtype)
    labels = np.zeros(rgb.shape[:3], np.int16)
    confidence = np.zeros((count, len(rgb)), np.float32)
    labels[key_index] = np.where(key_labels == UNKNOWN, BACKGROUND, key_labels)
    for i in range(count):
        confidence[i, key_index] = (key_labels == i + 1).any(axis=(1, 2))
    for before, after in pairwise([None, *range(len(key_index)), None]):
        near = _memory_keys(before, after, len(key_index), params.memory_keys)
        local = np.setdiff1d(np.unique(key_labels[near]), (BACKGROUND, UNKNOWN))
        prompts = {int(key_index[k]): key_labels[k][None] == local[:, None, None] for k in near}
        if not len(local):
            continue
        first, last = (None if k is None else int(key_index[k]) for k in (before, after))
        for at, logits in _blend_directions(model, rgb, prompts, first, last, params.cache_frames):
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


def _blend_directions(model: Any, rgb: np.ndarray, prompts: dict[int, np.ndarray], first: int | None, last: int | None,
             cache: int) -> Iterator[tuple[int, torch.Tensor]]:  # fmt: skip
    """Yield logits (n, h', w') of the frames between two key frames, or beyond the only one. Both passes share image features."""
    between = range(0 if first is None else first + 1, len(rgb) if last is None else last)
    if not between:
        return
    remembered = session(model, rgb, prompts, max(cache, 1))
    forwards: Iterable[FrameMasks] = ()
    if first is not None:
        forwards = track_frames(model, rgb, prompts, [first, *between], within=remembered)
    if first is None or last is None:
        backwards: Iterable[FrameMasks] = ()
        if last is not None:
            backwards = track_frames(model, rgb, prompts, [last, *between[::-1]], within=remembered)
        yield from ((seen.at, seen.logits) for way in (forwards, backwards) for seen in way if seen.at in between)
        return
    there = {seen.at: seen.logits.half() for seen in forwards if seen.at in between}
    for seen in track_frames(model, rgb, prompts, [last, *between[::-1]], within=remembered):
        if seen.at in between:
            nearness = (last - seen.at) / (last - first)
            yield seen.at, nearness * there.pop(seen.at).float() + (1 - nearness) * seen.logits


def _confidence(logits: np.ndarray, labels: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Mean probability (n,) float32 of the pixels of each entity, 0 for an entity without pixels."""
    out = np.zeros(len(local), np.float32)
    for i, label in enumerate(local):
        inside = logits[i][labels == label]
        out[i] = (1 / (1 + np.exp(-inside))).mean() if inside.size else 0.0
    return out
