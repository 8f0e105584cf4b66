"""Several valid ways to do a task against several hypotheses of a model. A mode, like a hypothesis, is a pair of regions."""

from __future__ import annotations

import numpy as np

from afford.common.masks import iou


def best_mode(found: np.ndarray, modes: np.ndarray) -> int:
    """The mode whose union of both hands `found` (h, w) agrees with best by IoU; `modes` (m, 2, h, w) bool. First of equals."""
    return int(np.argmax([iou(found, mode[0] | mode[1]) for mode in modes]))


def agreement(hypotheses: np.ndarray, modes: np.ndarray) -> np.ndarray:
    """(k, m) IoU of the unions of hands of every hypothesis (k, 2, h, w) with every mode (m, 2, h, w)."""
    truth = [mode[0] | mode[1] for mode in modes]
    return np.array([[iou(one[0] | one[1], mode) for mode in truth] for one in hypotheses])


def best_mode_iou(table: np.ndarray) -> float:
    """Mean over modes of the IoU of the hypothesis that fits it best: 1 only when every mode is found. `table` (k, m)."""
    return float(table.max(axis=0).mean())


def best_hypothesis_iou(table: np.ndarray) -> float:
    """IoU of the best pair: what a perfect ranking of the hypotheses would give. `table` (k, m)."""
    return float(table.max())
