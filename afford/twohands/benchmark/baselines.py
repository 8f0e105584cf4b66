"""Methods without a network: what any trained one must beat. Each is made from a data set (or None) and says a `Prediction` of a
case, or None where it has nothing to say.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from afford.common.masks import box
from schemas.benchmark import Case, Prediction

SPREAD = 0.15
"""standard deviation of the centre prior, in widths and heights of the image"""
Baseline = Callable[[Case], Prediction | None]


def whole_object(dataset: Path | None) -> Baseline:
    """Oracle: the complete object of each hand, as annotated. None where no object is."""
    return lambda case: _regions(case, case.objects)


def object_box(dataset: Path | None) -> Baseline:
    """Oracle: the box around the complete object of each hand."""
    return lambda case: _regions(case, np.stack([_filled(mask) for mask in case.objects]))


def centre(dataset: Path | None) -> Baseline:
    """A Gaussian in the middle of the image for both hands, whatever the task."""
    return _centre


def one_hypothesis(task: str, planes: np.ndarray, hands: np.ndarray, taxonomy: np.ndarray | None = None) -> Prediction:
    """One hypothesis per hand: (2, h, w) float32 probabilities, cut at 0.5; without `taxonomy` the method tells none."""
    told = np.full(4, np.nan) if taxonomy is None else taxonomy
    return Prediction(task, planes[:, None].astype(np.float32), np.ones((2, 1), np.float32), told.astype(np.float32), hands, 0.5)


def _centre(case: Case) -> Prediction:
    height, width = case.modes.shape[2:]
    y, x = np.mgrid[:height, :width]
    off = ((x + 0.5) / width - 0.5) ** 2 + ((y + 0.5) / height - 0.5) ** 2
    plane = np.exp(-off / (2 * SPREAD**2))
    return one_hypothesis(case.task, np.stack([plane, plane]), np.ones(2, bool))


def _regions(case: Case, masks: np.ndarray) -> Prediction | None:
    hands = np.array([mask.any() for mask in masks])
    return one_hypothesis(case.task, masks, hands) if hands.any() else None


def _filled(mask: np.ndarray) -> np.ndarray:
    out = np.zeros_like(mask)
    out[box(mask)] = True
    return out
