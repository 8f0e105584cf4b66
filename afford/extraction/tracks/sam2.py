"""SAM 2 follows the key frames' masks through the video, forwards and backwards; each frame trusts the nearer key frame more.

Between two key frames both are prompts, with `params.memory_keys` on each side in all; one way starts at the earlier, one at the
later, and their logits are mixed by nearness.
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


def propagate(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: Sam2) -> Propagated:
    """See `Propagate`. Where two entities claim a pixel, the larger logit has it; confidence is the mean probability inside."""
    model = load_model(params.model, params.device, params.dtype)
    labels = np.zeros(rgb.shape[:3], np.int16)
    confidence = np.zeros((count, len(rgb)), np.float32)
    labels[key_index] = np.where(key_labels == UNKNOWN, BACKGROUND, key_labels)
    for i in range(count):
        confidence[i, key_index] = (key_labels == i + 1).any(axis=(1, 2))
    for before, after in pairwise([None, *range(len(key_index)), None]):
        near = _near(before, after, len(key_index), params.memory_keys)
        local = np.setdiff1d(np.unique(key_labels[near]), (BACKGROUND, UNKNOWN))
        prompts = {int(key_index[k]): key_labels[k][None] == local[:, None, None] for k in near}
        if not len(local):
            continue
        first, last = (None if k is None else int(key_index[k]) for k in (before, after))
        for at, logits in _between(model, rgb, prompts, first, last, params.cache_frames):
            found = full_size(logits, rgb.shape[1:3])
            inside = found.max(axis=0) > 0
            labels[at] = np.where(inside, local[found.argmax(axis=0)], BACKGROUND)
            confidence[local - 1, at] = _confidence(found, labels[at], local)
    return Propagated(labels, confidence)


def _near(before: int | None, after: int | None, count: int, keys: int) -> list[int]:
    """Key frames that the model remembers between two neighbours: `keys` on each side, one at least."""
    early = range(max(before - max(keys, 1) + 1, 0), before + 1) if before is not None else range(0)
    late = range(after, min(after + max(keys, 1), count)) if after is not None else range(0)
    return [*early, *late]


def _between(model: Any, rgb: np.ndarray, prompts: dict[int, np.ndarray], first: int | None, last: int | None,
             cache: int) -> Iterator[tuple[int, torch.Tensor]]:  # fmt: skip
    """Logits (n, h', w') of the frames between two key frames, or beyond the only one. Both ways share the image features."""
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
    """(n,) float32: mean probability of the pixels that an entity got, 0 where it got none."""
    out = np.zeros(len(local), np.float32)
    for i, label in enumerate(local):
        inside = logits[i][labels == label]
        out[i] = (1 / (1 + np.exp(-inside))).mean() if inside.size else 0.0
    return out
