"""Propagation by SAM 2: every key frame is a prompt, the video is followed forwards and backwards from them.

Reads `params.model`: a local folder or hub id of a `Sam2VideoModel`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from afford.backends.propagate import BACKGROUND, UNKNOWN, Propagated
from afford.models.sam2_video import load_model, track


def propagate(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: Any) -> Propagated:
    """See `Propagate`. Where two entities claim a pixel, the larger logit has it; confidence is the mean sigmoid inside."""
    prompts = {int(at): _masks(labels, count) for at, labels in zip(key_index, key_labels, strict=True)}
    logits = track(load_model(params.model), rgb, prompts)
    labels = np.where(logits.max(axis=0) > 0, logits.argmax(axis=0) + 1, BACKGROUND).astype(np.int16)
    known = key_labels != UNKNOWN
    labels[key_index] = np.where(known, key_labels, labels[key_index])
    confidence = _confidence(logits, labels)
    confidence[:, key_index] = 1.0
    return Propagated(labels, confidence)


def _masks(labels: np.ndarray, count: int) -> np.ndarray:
    """(h, w) labels -> (count, h, w) bool."""
    return labels[None] == np.arange(1, count + 1)[:, None, None]


def _confidence(logits: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """(n, t) float32: mean probability of the pixels that an entity got, 0 where it got none."""
    out = np.zeros(logits.shape[:2], np.float32)
    for i in range(len(logits)):
        for t in range(logits.shape[1]):
            inside = logits[i, t][labels[t] == i + 1]
            out[i, t] = (1 / (1 + np.exp(-inside))).mean() if inside.size else 0.0
    return out
