"""Labels follow optical flow from both bracketing key frames and are fused by how consistent that flow is."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from afford.backends.propagate import UNKNOWN, Propagated
from afford.optical_flow import disagreement, flow_between, identity_map, sample

SIGMA_PX = 1.0


def propagate(rgb: np.ndarray, key_index: np.ndarray, key_labels: np.ndarray, count: int, params: Any) -> Propagated:
    """See the contract in `afford.backends.propagate`."""
    grey = [cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) for image in rgb]
    t, (h, w) = len(rgb), grey[0].shape
    forward = [flow_between(grey[i], grey[i + 1]) for i in range(t - 1)]
    backward = [flow_between(grey[i + 1], grey[i]) for i in range(t - 1)]
    score = np.zeros((t, count + 1, h, w), np.float32)
    for k, at in enumerate(key_index):
        hot = np.stack([key_labels[k] == i for i in range(count + 1)], axis=-1).astype(np.float32)
        left = key_index[k - 1] if k else -1
        right = key_index[k + 1] if k + 1 < len(key_index) else t
        for step, stop in ((1, right), (-1, left)):
            where, trust = identity_map(h, w), np.ones((h, w), np.float32)
            for i in range(at + step, stop, step):
                to, fro = (backward[i - 1], forward[i - 1]) if step > 0 else (forward[i], backward[i])
                at_last = identity_map(h, w) + to
                trust = sample(trust, at_last) * np.exp(-((disagreement(to, fro) / SIGMA_PX) ** 2))
                where = sample(where, at_last, outside=-1e4)
                span = max(abs(stop - at), 1)
                weight = (1e-3 + trust) * (1 - abs(i - at) / span if 0 <= stop < t else 1.0)
                score[i] += (cv2.remap(hot, where, None, cv2.INTER_LINEAR) * weight[..., None]).transpose(2, 0, 1)
    labels = score.argmax(axis=1).astype(np.int16)
    labels[key_index] = np.where(key_labels == UNKNOWN, 0, key_labels)
    total = score.sum(axis=1) + 1e-9
    confidence = np.zeros((count, t), np.float32)
    for i in range(count):
        for j in range(t):
            mine = labels[j] == i + 1
            if mine.any():
                confidence[i, j] = (score[j, i + 1] / total[j])[mine].mean()
        confidence[i, key_index] = [(key == i + 1).any() for key in key_labels]
    return Propagated(labels, confidence)
